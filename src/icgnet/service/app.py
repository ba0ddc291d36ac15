"""The HTTP application: what is answered under which address, and who may ask."""

import asyncio
import logging
import re
import secrets
import time
from collections.abc import Callable, Mapping
from http import HTTPStatus
from typing import TYPE_CHECKING, Annotated, Any, Protocol, runtime_checkable

from fastapi import APIRouter, Depends, FastAPI, HTTPException, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from starlette.exceptions import HTTPException as StarletteHTTPException
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from icgnet import __version__
from icgnet.errors import IcgnetError
from icgnet.predictor import Predictor
from icgnet.service import metrics
from icgnet.service.answers import MEDIA, json_bytes
from icgnet.service.bodies import JSON, NPZ, PNG, Ask, read_ask
from icgnet.service.config import ServiceConfig
from icgnet.service.options import LONGEST_QUERY, OPTIONS, PICK_OPTIONS, Option, options_of_query
from icgnet.service.predicting import Predicting, TooLateError
from icgnet.service.worker import FullError, GoneError, StoppingError, Worker

if TYPE_CHECKING:  # its packages are an extra
    from icgnet.service.picking import PickBench

LOG = logging.getLogger("uvicorn.error")
GONE = 499
"""Nobody reads this status: the caller has closed the connection."""
RETRY_AFTER = "Retry-After"
NO_ARM = "this service has no arm: it must be started with icgnet serve --arm"
LOCAL_HOST = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d+)?", re.IGNORECASE)


@runtime_checkable
class Answering(Protocol):
    """What a route does with what a request asks."""

    def check(self, ask: Ask) -> None:
        """Refuses, in any thread, what can be refused at once."""

    def answer(self, ask: Ask, arrived: float) -> bytes:
        """The answer to a request that came at this time, in the thread of the worker."""
        ...


class Service:
    """What the routes share.

    Args:
        predictor: finds objects and grasps.
        config: what is taken.
        weights: what is told about the weights, under `/metadata`.
        bench: the arm that picks are planned for; None if there is none, and then `/pick` says so.
    """

    def __init__(
        self,
        predictor: Predictor,
        config: ServiceConfig,
        weights: Mapping[str, Any],
        bench: "PickBench | None" = None,
    ) -> None:
        self.config = config
        self.weights = weights
        self.worker = Worker(config.queue)
        self.metrics = metrics.Metrics(lambda: float(self.worker.taken))
        self.predicting = Predicting(predictor, config.deadline_ms, self.metrics)
        self.bench = bench


def create_app(service: Service, token: str | None = None) -> FastAPI:
    """The application with all of `ROUTES`.

    Args:
        service: what its routes share.
        token: that every request but those for `/health` and the pages of OpenAPI must bring; None for none, and then
            only requests to this machine's own names are answered, so that no web page gets at it by another name.

    Raises:
        InputError: a token is needed and there is none, or it is a bad one.
    """
    service.config.check_token(token)
    app = FastAPI(
        title="icgnet",
        version=__version__,
        description="From a depth image or a cloud of a cluttered table to objects, shapes and ranked grasps.",
    )
    for make in ROUTES:
        app.include_router(make(service), dependencies=[Depends(_token_check(token))])
    app.include_router(health_route(service))
    for kind, respond in _RESPONSES.items():
        app.add_exception_handler(kind, respond)
    app.add_middleware(_Outermost, service=service)
    return app


def health_route(service: Service) -> APIRouter:
    """`/health`: whether requests are taken."""
    router = APIRouter()

    @router.get("/health", summary="Whether requests are taken")
    async def health() -> Response:
        if service.worker.is_stopping:
            raise StoppingError
        return _json({"status": "ok"})

    return router


def metadata_route(service: Service) -> APIRouter:
    """`/metadata`: what is served."""
    router = APIRouter()
    predictor, config = service.predicting.predictor, service.config
    search = predictor.search
    told = {
        "icgnet": __version__,
        "weights": dict(service.weights),
        "classes": list(predictor.classes),
        "gripper": predictor.gripper.to_dict(),
        "arm": None if service.bench is None else service.bench.to_dict(),
        "units": {"length": "m", "angle": "rad", "time": "ms", "depth": "depth_scale stored units are 1 m"},
        "frames": {
            "world": "z up; of results, if a camera pose, a viewpoint or the height of the table is given",
            "camera": "x right, y down, z forward; of results, if none of these is given",
            "base": "of the arm, and of everything in a plan",
            "table": "z up, the table plane at z = 0.05 m; T_frame_table leads from there to the frame of the result",
            "grasp": "z approach, y closing, origin midway between the finger tips",
        },
        "search": {"min_score": search.min_score, "select": search.select, "budget_ms": search.budget_ms},
        "limits": {
            "max_bytes": config.max_bytes,
            "max_points": config.max_points,
            "queue": config.queue,
            "deadline_ms": config.deadline_ms,
            "body_seconds": config.body_seconds,
        },
    }

    @router.get("/metadata", summary="Weights, classes, hand, units, frames and limits")
    async def metadata() -> Response:
        return _json(told)

    return router


def metrics_route(service: Service) -> APIRouter:
    """`/metrics`: counts and times for Prometheus."""
    router = APIRouter()

    @router.get("/metrics", summary="Counts and times for Prometheus")
    async def page() -> Response:
        return Response(service.metrics.page(), media_type=metrics.MEDIA)

    return router


def predict_route(service: Service) -> APIRouter:
    """`/predict`: objects and grasps."""
    router = APIRouter()

    @router.post(
        "/predict",
        summary="Objects and grasps in a depth image or a cloud",
        responses=PREDICT_RESPONSES,
        openapi_extra=_request_body(OPTIONS),
    )
    async def predict(request: Request) -> Response:
        return await _answered(request, service, service.predicting, OPTIONS)

    return router


def pick_route(service: Service) -> APIRouter:
    """`/pick`: a plan for the arm of the service; it moves none."""
    router = APIRouter()
    answering = None if service.bench is None else service.bench.answering(service.predicting)

    @router.post(
        "/pick",
        summary="A plan for the service's arm, from a depth image; nothing moves",
        responses=PICK_RESPONSES,
        openapi_extra=_request_body(PICK_OPTIONS),
    )
    async def pick(request: Request) -> Response:
        if answering is None:
            raise HTTPException(HTTPStatus.NOT_FOUND, NO_ARM)
        return await _answered(request, service, answering, PICK_OPTIONS)

    return router


ROUTES: tuple[Callable[[Service], APIRouter], ...] = (metadata_route, predict_route, pick_route, metrics_route)
"""What needs the token, if there is one. Each takes the service and gives its routes."""


async def _answered(
    request: Request, service: Service, answering: Answering, options: Mapping[str, Option]
) -> Response:
    """The way of a request: a place, its body under the limits, reading beside the event loop, the worker."""
    arrived = time.monotonic()
    config = service.config
    with service.worker.place():
        kind = _kind(request)
        query = _query(request, options)
        body = await _body(request, config.max_bytes, config.body_seconds)

        def read() -> Ask:
            ask = read_ask(kind, body, query, config.max_points, options)
            answering.check(ask)
            return ask

        ask = await asyncio.to_thread(read)
        answer = await service.worker.run(lambda: answering.answer(ask, arrived), lambda: _gone(request))
    return Response(answer, headers={"Content-Type": MEDIA[ask.options.get("answer", "json")]})


def _token_check(token: str | None) -> Callable[..., Any]:
    """The check of the token, which OpenAPI then knows; if there is none, of the name that the request is sent to."""
    if token is None:

        async def check_host(request: Request) -> None:
            host = request.headers.get("host", "")
            if not LOCAL_HOST.fullmatch(host):
                raise HTTPException(
                    HTTPStatus.BAD_REQUEST,
                    f"without a token only requests to localhost are answered, not to {host[:80]!r}",
                )

        return check_host
    wanted = token.encode()

    async def check(
        given: Annotated[HTTPAuthorizationCredentials | None, Depends(HTTPBearer(auto_error=False))],
    ) -> None:
        if given is None or not secrets.compare_digest(given.credentials.encode(), wanted):
            raise HTTPException(
                HTTPStatus.UNAUTHORIZED,
                "this service needs its token: send the header Authorization: Bearer TOKEN",
                {"WWW-Authenticate": "Bearer"},
            )

    return check


def _kind(request: Request) -> str:
    """Media type of the body."""
    given = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if given not in (PNG, NPZ, JSON):
        raise HTTPException(
            HTTPStatus.UNSUPPORTED_MEDIA_TYPE, f"Content-Type must be one of {PNG}, {NPZ}, {JSON}, got {given[:80]!r}"
        )
    if request.headers.get("content-encoding", "identity").lower() != "identity":
        raise HTTPException(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "Content-Encoding is not taken: send the body as it is")
    return given


def _query(request: Request, options: Mapping[str, Option]) -> dict[str, Any]:
    if len(request.scope["query_string"]) > LONGEST_QUERY:
        raise HTTPException(HTTPStatus.REQUEST_URI_TOO_LONG, f"the query must be at most {LONGEST_QUERY} characters")
    return options_of_query(request.query_params.multi_items(), options)


async def _body(request: Request, most: int, seconds: float) -> bytes:
    """The body, of which no more than the limit is ever held."""
    announced = request.headers.get("content-length", "0")
    body = bytearray()
    if not announced.isdecimal() or int(announced[:20]) <= most:
        try:
            async with asyncio.timeout(seconds):
                async for chunk in request.stream():
                    body += chunk
                    if len(body) > most:
                        break
                else:
                    return bytes(body)
        except TimeoutError:
            raise HTTPException(
                HTTPStatus.REQUEST_TIMEOUT, f"the body did not come within {seconds:g} s", {"Connection": "close"}
            ) from None
    raise HTTPException(
        HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"the body must be at most {most} bytes", {"Connection": "close"}
    )


async def _gone(request: Request) -> None:
    """Ends when the caller closes the connection."""
    while (await request.receive())["type"] != "http.disconnect":
        pass


def _json(values: Mapping[str, Any], status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    return Response(json_bytes(values), status, headers, media_type=JSON)


def _refusal(message: str, status: int, headers: Mapping[str, str] | None = None) -> Response:
    return _json({"error": " ".join(message.split())}, status, headers)


async def _of_http(request: Request, error: Any) -> Response:
    return _refusal(str(error.detail), error.status_code, error.headers)


async def _of_caller(request: Request, error: Any) -> Response:
    return _refusal(str(error), HTTPStatus.UNPROCESSABLE_ENTITY)


async def _of_full(request: Request, error: Any) -> Response:
    return _refusal(str(error), HTTPStatus.TOO_MANY_REQUESTS, {RETRY_AFTER: str(error.retry_after)})


async def _of_stopping(request: Request, error: Any) -> Response:
    return _refusal(str(error), HTTPStatus.SERVICE_UNAVAILABLE, {RETRY_AFTER: "5"})


async def _of_late(request: Request, error: Any) -> Response:
    return _refusal(str(error), HTTPStatus.GATEWAY_TIMEOUT)


async def _of_gone(request: Request, error: Any) -> Response:
    return Response(status_code=GONE)


_RESPONSES = {
    StarletteHTTPException: _of_http,
    RequestValidationError: _of_caller,
    IcgnetError: _of_caller,
    FullError: _of_full,
    StoppingError: _of_stopping,
    TooLateError: _of_late,
    GoneError: _of_gone,
    ClientDisconnect: _of_gone,
}


class _Outermost:
    """Counts requests by route and status, all that are no route as one, and answers errors that nobody foresaw."""

    def __init__(self, app: ASGIApp, service: Service) -> None:
        self._app = app
        self._requests = service.metrics.requests

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        status = None

        async def counted_send(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self._app(scope, receive, counted_send)
        except Exception:
            if status is not None:  # too late for another answer
                raise
            LOG.exception("internal error in an answer to %s", scope["path"])
            await _refusal("internal error: the log of the service tells more", 500)(scope, receive, counted_send)
        finally:
            route = getattr(scope.get("route"), "path", "other")
            self._requests.labels(route, str(status)).inc()


_ERROR = {"content": {JSON: {"schema": {"type": "object", "properties": {"error": {"type": "string"}}}}}}
PREDICT_RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The result: as `result.json` of icgnet predict; an npz with `result` (the same JSON as bytes), "
        "`instance_mask` and, of object k, `vertices_k` and `faces_k`; or a table of the grasps.",
        "content": {media.partition(";")[0]: {} for media in MEDIA.values()},
    },
    401: {"description": "No token, or a wrong one.", **_ERROR},
    408: {"description": "The body came too slowly.", **_ERROR},
    413: {"description": "The body is too large.", **_ERROR},
    415: {"description": "The body is of an unknown kind.", **_ERROR},
    422: {"description": "The values are not usable; the line says which, and what is valid.", **_ERROR},
    429: {"description": "Too many requests wait; ask again after Retry-After seconds.", **_ERROR},
    503: {"description": "The service is stopping.", **_ERROR},
    504: {"description": "The deadline passed before the prediction had begun.", **_ERROR},
}
PICK_RESPONSES: dict[int | str, dict[str, Any]] = {
    **PREDICT_RESPONSES,
    200: {
        "description": "`plan`: as `plan.json` of icgnet pick, without phases if no grasp can be carried out, and then "
        "`refused` counts why; `prediction`: as `result.json` without grasps, and their number; `picked`: the grasp.",
        "content": {JSON: {}},
    },
    404: {"description": "The service has no arm.", **_ERROR},
}
_BINARY = {"schema": {"type": "string", "format": "binary"}}


def _request_body(options: Mapping[str, Option]) -> dict[str, Any]:
    """How OpenAPI describes a request with an image or a cloud and these options."""
    has_clouds = "viewpoint" in options
    points = {"points": {"type": "array", "items": {"type": "array", "items": {"type": "number"}}}}
    properties = {
        "depth": {"type": "string", "format": "byte"},
        "mask": {"type": "string", "format": "byte"},
        **(points if has_clouds else {}),
        **{name: option.schema() for name, option in options.items()},
    }
    or_points, or_cloud = (" or points,", ", or points (and viewpoint)") if has_clouds else ("", "")
    return {
        "parameters": [
            {
                "name": name,
                "in": "query",
                "required": False,
                "description": option.about,
                "schema": option.schema(),
                **({"style": "form", "explode": False} if option.kind == "numbers" else {}),
            }
            for name, option in options.items()
        ],
        "requestBody": {
            "required": True,
            "description": f"A 16-bit PNG; an npz with depth and K (and camera_pose, mask){or_cloud}; or JSON with "
            f"depth (a PNG in base64, and perhaps mask){or_points} and any option.",
            "content": {
                PNG: _BINARY,
                NPZ: _BINARY,
                JSON: {"schema": {"type": "object", "additionalProperties": False, "properties": properties}},
            },
        },
    }

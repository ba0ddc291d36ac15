"""Asks a service that `icgnet serve` runs. Needs numpy and httpx only: no torch, and nothing else of this package.

client = Client("http://127.0.0.1:8000")
answer = client.predict_depth(depth, K, camera_pose=T_base_camera)
best = answer.best()
"""

import io
import json
import random
import time
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

import httpx
import numpy as np

from icgnet.errors import IcgnetError, InputError

NPZ = "application/x-npz"
RESULT = ("objects", "grasps", "frame_id")
FULL, STOPPING, REFUSED = 429, 503, (413, 415, 422)
LOCAL = ("127.0.0.1", "localhost", "::1")
FIRST_WAIT = 0.2
"""Before a lost connection is tried again; twice as long each further time [s]."""
LONGEST_WAIT = 30.0
"""No wish of a service to be asked later is followed for longer than this [s]."""


class ServiceError(IcgnetError):
    """The service cannot be reached, or does not answer with a result.

    Attributes:
        status: of its answer; None when there was none.
    """

    def __init__(self, message: str, status: int | None = None) -> None:
        super().__init__(message)
        self.status = status


@dataclass(frozen=True, eq=False)
class Answer:
    """What the service found. Coordinates are in the frame `frame_id`, in metres.

    Attributes:
        result: the entries of `result.json`, see the guides, and under `service` how long the request waited.
        instance_mask: the instance of every input point or pixel, -1 for none; only with `meshes=True`.
        meshes: vertices [n 3] in metres and triangles [f 3] by instance_id; only with `meshes=True`.
    """

    result: dict[str, Any]
    instance_mask: np.ndarray | None = None
    meshes: dict[int, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    @property
    def frame_id(self) -> str:
        """Name of the frame that everything is in."""
        return self.result["frame_id"]

    @property
    def objects(self) -> list[dict[str, Any]]:
        """The objects, numbered from 0."""
        return self.result["objects"]

    @property
    def grasps(self) -> list[dict[str, Any]]:
        """Collision-free grasps, best first."""
        return self.result["grasps"]

    @property
    def poses(self) -> np.ndarray:
        """[g 4 4] poses of the grasps: z approach, y closing, origin midway between the finger tips."""
        return np.array([grasp["pose"] for grasp in self.grasps], dtype=np.float64).reshape(-1, 4, 4)

    def best(self) -> dict[str, Any] | None:
        """The grasp to try first; None when there is none."""
        return self.grasps[0] if self.grasps else None


@dataclass(frozen=True, eq=False)
class PickAnswer:
    """A plan of the service for its arm: nothing has moved. In the frame of the arm's base, in metres and radians.

    Attributes:
        result: `plan` (the entries of `plan.json`, see the guides), `picked` (the grasp, in the frame of the
            prediction; None if there is none), `prediction` (what was found, and the number of its grasps), `service`.
    """

    result: dict[str, Any]

    @property
    def is_found(self) -> bool:
        """Whether a grasp can be carried out."""
        return bool(self.phases)

    @property
    def phases(self) -> list[dict[str, Any]]:
        """What the arm does, one after the other, each with its `joint_trajectory`; empty if there is no plan."""
        return self.result["plan"]["phases"]

    @property
    def refused(self) -> dict[str, int]:
        """How many grasps cannot be carried out, by reason."""
        return self.result["plan"]["refused"]

    @property
    def T_base_grasp(self) -> np.ndarray | None:
        """[4 4] pose of the grasp; None if there is no plan."""
        pose = self.result["plan"]["T_base_grasp"]
        return None if pose is None else np.array(pose, dtype=np.float64)


class Client:
    """Asks one service. The connection is kept, and opened again when it was lost.

    Args:
        url: of the service, such as "http://127.0.0.1:8000".
        token: that the service wants, if it wants one.
        timeout: for connecting, for sending and for the answer, each [s].
        retries: how often a request is sent again when the service is full or stopping, or the connection was lost.
            An answer that does not come within the timeout is not asked for again.
        transport: of httpx, for tests.

    Raises:
        InputError: no address of http or https, or numbers out of range.
    """

    def __init__(
        self,
        url: str,
        token: str | None = None,
        timeout: float = 30.0,
        retries: int = 3,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        if not str(url).startswith(("http://", "https://")):
            raise InputError(f"url must begin with http:// or https://, got {url!r}")
        if not timeout > 0:
            raise InputError(f"timeout must be above 0 s, got {timeout!r}")
        if retries < 0:
            raise InputError(f"retries must be at least 0, got {retries!r}")
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        self._retries, self._timeout = retries, timeout
        try:
            # What is for this machine, and the token, goes to no proxy that the environment names.
            far = httpx.URL(url).host not in LOCAL
        except httpx.InvalidURL as error:
            raise InputError(f"url {url!r} is no address: {error}") from error
        self._http = httpx.Client(base_url=url, headers=headers, timeout=timeout, transport=transport, trust_env=far)

    def __enter__(self) -> "Client":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connection."""
        self._http.close()

    def health(self) -> bool:
        """Whether the service takes requests; asked once, and False also when nothing is there."""
        try:
            return self._http.get("/health").status_code == httpx.codes.OK
        except httpx.TransportError:
            return False

    def metadata(self) -> dict[str, Any]:
        """Weights, classes, hand, units, frames and limits of the service.

        Raises:
            ServiceError: it cannot be reached, or refuses.
        """
        return self._read(self._ask("GET", "/metadata"), ("classes", "gripper"))

    def predict_depth(
        self,
        depth: Any,
        intrinsics: Any,
        camera_pose: Any = None,
        table_height: float | None = None,
        mask: Any = None,
        level_table: bool = False,
        frame_id: str | None = None,
        meshes: bool = False,
        depth_scale: float | None = None,
        **options: Any,
    ) -> Answer:
        """Objects and grasps in a depth image; arguments as of `icgnet.Predictor.predict_depth`.

        Args:
            depth: [h w] distance along the camera's z axis; 0 or NaN where nothing was measured.
            intrinsics: [3 3] camera matrix [pixels].
            camera_pose: T_world_camera as [4 4] or x y z [m] qw qx qy qz; None when it is not known.
            table_height: height of the table in the world [m]; it is found if None.
            mask: [h w] true where objects may be; everywhere if None.
            level_table: whether the depth is multiplied with what brings the table to its height.
            frame_id: how the world is called in the result.
            meshes: whether the meshes and the instance mask are sent, too.
            depth_scale: stored units per metre; None for a depth in metres.
            options: `object_class`, `instance`, `region`, `limit`, `deadline_ms`.

        Raises:
            InputError: the service refuses the values; the message is its own.
            ServiceError: it cannot be reached, is full, stops, or is too late.
        """
        arrays = {"depth": depth, "K": intrinsics, "camera_pose": camera_pose, "mask": mask}
        query = {"table_height": table_height, "level_table": level_table or None, "frame_id": frame_id}
        return self._predict(arrays, {**query, "depth_scale": depth_scale, **options}, meshes)

    def predict_cloud(
        self,
        points: Any,
        viewpoint: Any = None,
        table_height: float | None = None,
        frame_id: str | None = None,
        meshes: bool = False,
        **options: Any,
    ) -> Answer:
        """Objects and grasps in a cloud; arguments as of `icgnet.Predictor.predict_cloud`.

        Args:
            points: [n 3] positions [m].
            viewpoint: [3] where the camera stood [m]; None when it is not known.
            table_height: height of the table [m]; it is found if None.
            frame_id: how the world is called in the result.
            meshes: whether the meshes and the instance of each point are sent, too.
            options: `object_class`, `instance`, `region`, `limit`, `deadline_ms`.

        Raises:
            InputError: the service refuses the values; the message is its own.
            ServiceError: it cannot be reached, is full, stops, or is too late.
        """
        query = {"table_height": table_height, "frame_id": frame_id, **options}
        return self._predict({"points": points, "viewpoint": viewpoint}, query, meshes)

    def pick(
        self,
        depth: Any,
        intrinsics: Any,
        drop: Any,
        camera_pose: Any = None,
        joints: Any = None,
        mask: Any = None,
        level_table: bool = False,
        **options: Any,
    ) -> PickAnswer:
        """A plan for the arm of the service.

        Args:
            depth: [h w] distance along the camera's z axis; 0 or NaN where nothing was measured.
            intrinsics: [3 3] camera matrix [pixels].
            drop: [3] where the object is let go of: its lowest point, in the world [m].
            camera_pose: T_world_camera as [4 4] or x y z [m] qw qx qy qz; None for the hand-eye file of the service.
            joints: of the arm when the picture was taken [rad]; only for a camera on the arm.
            mask: [h w] true where objects may be; everywhere if None.
            level_table: whether the depth is multiplied with what brings the table to its height.
            options: `object_class`, `instance`, `region`, `start`, `release`, `table_height`, `depth_scale`,
                `frame_id`, `deadline_ms`.

        Raises:
            InputError: the service refuses the values; the message is its own.
            ServiceError: it cannot be reached, has no arm, is full, stops, or is too late.
        """
        arrays = {"depth": depth, "K": intrinsics, "camera_pose": camera_pose, "mask": mask}
        query = {"drop": drop, "joints": joints, "level_table": level_table or None, **options}
        return PickAnswer(self._read(self._post("/pick", arrays, query), ("plan", "picked")))

    def _predict(self, arrays: dict[str, Any], options: dict[str, Any], meshes: bool) -> Answer:
        response = self._post("/predict", arrays, {**options, "answer": "npz" if meshes else "json"})
        if not meshes:
            return Answer(self._read(response, RESULT))
        try:
            return _answer_of_npz(response.content)
        except (ValueError, KeyError, EOFError, OSError, zipfile.BadZipFile, zlib.error) as error:
            raise self._strange(response) from error

    def _read(self, response: httpx.Response, wanted: tuple[str, ...]) -> dict[str, Any]:
        """The JSON of an answer; what else listens under an address may answer anything."""
        try:
            values = response.json()
        except ValueError as error:
            raise self._strange(response) from error
        if not isinstance(values, dict) or not set(wanted) <= set(values):
            raise self._strange(response)
        return values

    def _strange(self, response: httpx.Response) -> ServiceError:
        told = " ".join(response.text[:200].split())
        return ServiceError(f"{self._http.base_url} is no service of icgnet: it answers {told!r}", response.status_code)

    def _post(self, path: str, arrays: dict[str, Any], options: dict[str, Any]) -> httpx.Response:
        """The answer to arrays and options."""
        content = io.BytesIO()
        try:
            given: dict[str, Any] = {name: np.asarray(value) for name, value in arrays.items() if value is not None}
        except ValueError as error:  # ragged lists
            raise InputError(f"{', '.join(arrays)} must be arrays of numbers: {error}") from error
        for name, value in given.items():
            if value.dtype.kind not in "biuf":
                raise InputError(f"{name} must be arrays of numbers, got {value.dtype}")
        np.savez(content, **given)
        query = {name: _text(value, name) for name, value in options.items() if value is not None}
        return self._ask("POST", path, query, content.getvalue())

    def _ask(
        self, method: str, path: str, query: dict[str, str] | None = None, body: bytes | None = None
    ) -> httpx.Response:
        """The answer to a request, which is sent again while that is worth it."""
        headers = {} if body is None else {"Content-Type": NPZ}
        wait = FIRST_WAIT
        for left in reversed(range(self._retries + 1)):
            try:
                response = self._http.request(method, path, params=query, content=body, headers=headers)
            except httpx.ReadTimeout as error:
                raise ServiceError(
                    f"{self._http.base_url} did not answer within {self._timeout:g} s: it is busy, or timeout is short"
                ) from error
            except httpx.UnsupportedProtocol as error:
                raise ServiceError(f"no answer from {self._http.base_url}: {_said(error)}") from error
            except httpx.TransportError as error:
                if not left:
                    raise ServiceError(f"cannot reach {self._http.base_url}: {_said(error)}") from error
                time.sleep(wait * random.uniform(0.5, 1.0))
                wait = min(2 * wait, LONGEST_WAIT)
                continue
            if response.status_code == httpx.codes.OK:
                return response
            if response.status_code not in (FULL, STOPPING) or not left:
                break
            time.sleep(_retry_after(response, wait) * random.uniform(1.0, 1.25))
            wait = min(2 * wait, LONGEST_WAIT)
        message = _error_in(response)
        if response.status_code in REFUSED:
            raise InputError(message)
        raise ServiceError(f"{self._http.base_url} answers {response.status_code}: {message}", response.status_code)


def _text(value: Any, name: str) -> str:
    """A value in a query string."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, np.ndarray | Sequence) and not isinstance(value, str):
        try:
            return ",".join(repr(float(number)) for number in np.ravel(value))
        except (TypeError, ValueError) as error:  # ragged lists, texts
            raise InputError(f"{name} must be numbers, got {str(value)[:80]}") from error
    return str(value)


def _retry_after(response: httpx.Response, otherwise: float) -> float:
    """When the service wants to be asked again [s]; it says so in whole seconds."""
    given = response.headers.get("Retry-After", "")
    return min(float(given), LONGEST_WAIT) if given.isascii() and given.isdecimal() else otherwise


def _error_in(response: httpx.Response) -> str:
    """The line that says what was wrong; the beginning of any other text that came instead."""
    try:
        return str(response.json()["error"])
    except (ValueError, KeyError, TypeError):
        return " ".join(response.text.split())[:200] or response.reason_phrase


def _said(error: Exception) -> str:
    return str(error) or type(error).__name__


def _answer_of_npz(content: bytes) -> Answer:
    with np.load(io.BytesIO(content), allow_pickle=False) as saved:
        result = json.loads(saved["result"].tobytes())
        ids = [int(item["instance_id"]) for item in result["objects"]]
        meshes = {number: (saved[f"vertices_{number}"], saved[f"faces_{number}"]) for number in ids}
        return Answer(result, saved["instance_mask"].astype(np.int64), meshes)

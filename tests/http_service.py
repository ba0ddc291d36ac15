"""A service on a free port of this machine, a predictor that can be held up, and what is sent to it."""

import io
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from PIL import Image

from icgnet.inference.prediction import Prediction
from icgnet.predictor import Predictor
from icgnet.service.app import Service
from icgnet.service.config import ServiceConfig
from icgnet.service.server import Server, listen
from tabletop_scenes import INTRINSICS, THREE_BOXES, camera_pose, depth_image, tiny_network

if TYPE_CHECKING:
    from icgnet.service.picking import PickBench

TOKEN = "a token of the tests".replace(" ", "-")
POSE = camera_pose()
DEPTH = depth_image(THREE_BOXES, POSE).astype(np.float32)
PINHOLE = "135,135,80,60"


@cache
def tiny_predictor() -> Predictor:
    return Predictor(tiny_network())


@cache
def known_prediction() -> Prediction:
    """What the tiny network finds, with a box for the shape of each object: it sees none itself."""
    found = tiny_predictor().predict_depth(DEPTH, INTRINSICS, POSE)
    objects = [
        replace(item, extract=lambda item=item: trimesh.creation.box(bounds=[item.points.min(0), item.points.max(0)]))
        for item in found.objects
    ]
    return replace(found, objects=tuple(objects))


def wait_until(holds: Callable[[], bool], seconds: float = 30.0) -> None:
    """Until it holds, which fails after that time."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.005)


class HeldUpPredictor(Predictor):
    """Gives the same prediction for everything, once it is let go; notes the budgets and poses that it was given.

    Args:
        prediction: that of the tiny network if None.
    """

    def __init__(self, prediction: Prediction | None = None) -> None:
        tiny = tiny_predictor()
        super().__init__(tiny.network)
        self.prediction = prediction
        self.poses: list[np.ndarray | None] = []
        self.begun = threading.Semaphore(0)
        self.may_end = threading.Event()
        self.may_end.set()
        self.budgets: list[float | None] = []
        self.error: Exception | None = None

    def predict_depth(self, *args, **kwargs) -> Prediction:
        self.begun.release()
        assert self.may_end.wait(30)
        self.poses.append(args[2] if len(args) > 2 else None)
        self.budgets.append(self.search.budget_ms)
        if self.error is not None:
            raise self.error
        return known_prediction() if self.prediction is None else self.prediction

    predict_cloud = predict_depth

    def with_search(self, **changes) -> "HeldUpPredictor":
        other = object.__new__(HeldUpPredictor)
        other.__dict__ = self.__dict__ | {"search": replace(self.search, **changes)}
        return other


@contextmanager
def running(
    predictor: Predictor, token: str | None = None, bench: "PickBench | None" = None, **config
) -> Iterator[tuple[str, Service, Server]]:
    """The address, the service and the server, which is told to stop in the end."""
    service = Service(predictor, ServiceConfig(port=0, **config), {"sha256": "of no file"}, bench)
    server = Server(service, token)
    with listen("127.0.0.1", 0) as opened:
        thread = threading.Thread(target=server.run, args=([opened],))
        thread.start()
        try:
            yield f"http://127.0.0.1:{opened.getsockname()[1]}", service, server
        finally:
            server.should_exit = True
            thread.join(30)
    assert not thread.is_alive()


def png(image: np.ndarray) -> bytes:
    content = io.BytesIO()
    Image.fromarray(image).save(content, "PNG")
    return content.getvalue()


def depth_png() -> bytes:
    return png((1000 * DEPTH).round().astype(np.uint16))


def npz(**arrays) -> bytes:
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    return content.getvalue()

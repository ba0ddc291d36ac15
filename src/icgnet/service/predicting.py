"""What the worker does for one request."""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from icgnet.errors import InputError
from icgnet.inference.prediction import Prediction
from icgnet.objects.classes import class_index
from icgnet.predictor import Predictor
from icgnet.service.answers import answer_bytes
from icgnet.service.bodies import Ask
from icgnet.service.metrics import Metrics

LEAST_BUDGET = 1.0
"""With less than this left, a prediction is not begun [ms]."""


class TooLateError(Exception):
    """The deadline of a request passed before its prediction had begun."""


class Predicting:
    """Predicts for requests, in the worker's thread.

    Args:
        predictor: finds objects and grasps.
        deadline_ms: of requests that name none; None for no deadline.
        metrics: what is counted.
        clock: tells the time [s].
    """

    def __init__(
        self,
        predictor: Predictor,
        deadline_ms: float | None,
        metrics: Metrics,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.predictor = predictor
        self.metrics = metrics
        self._deadline_ms = deadline_ms
        self._clock = clock

    def check(self, ask: Ask) -> None:
        """Refuses what can be refused without a prediction.

        Raises:
            InputError: a class that the weights do not know, or a region whose corners are the wrong way round.
        """
        options = ask.options
        if "object_class" in options:
            class_index(options["object_class"], self.predictor.classes)
        if "region" in options and (options["region"][:3] > options["region"][3:]).any():
            raise InputError(f"region must have lower <= upper, got {options['region'].tolist()}")

    def answer(self, ask: Ask, arrived: float) -> bytes:
        """The answer to a request.

        Args:
            ask: what is asked.
            arrived: when the request came, by the clock [s].

        Raises:
            InputError: the values are no scene; see `Predictor`.
            TooLateError: there is no time left to begin.
        """
        prediction, waited_ms = self.predict(ask, arrived)
        return answer_bytes(prediction, ask.options.get("answer", "json"), {"waited_ms": waited_ms})

    def predict(self, ask: Ask, arrived: float) -> tuple[Prediction, float]:
        """What is found, with the grasps that are asked for, and how long the request waited [ms].

        Args:
            ask: what is asked.
            arrived: when the request came, by the clock [s].

        Raises:
            InputError: the values are no scene; see `Predictor`.
            TooLateError: there is no time left to begin.
        """
        begun = self._clock()
        waited = begun - arrived
        self.metrics.waiting.observe(waited)
        prediction = _chosen(_predict(self._within(ask, arrived), ask), ask)
        self.metrics.predicting.observe(self._clock() - begun)
        self.metrics.objects.inc(len(prediction.objects))
        self.metrics.grasps.inc(len(prediction.grasps))
        return prediction, round(1e3 * waited, 3)

    def left_ms(self, ask: Ask, arrived: float) -> float | None:
        """What is left of the deadline of a request [ms], below 0 if it has passed; None for no deadline."""
        deadline = ask.options.get("deadline_ms", self._deadline_ms)
        return None if deadline is None else deadline - 1e3 * (self._clock() - arrived)

    def _within(self, ask: Ask, arrived: float) -> Predictor:
        """The predictor with what is left of the deadline as its budget, unless its own is smaller."""
        left = self.left_ms(ask, arrived)
        if left is None:
            return self.predictor
        if left < LEAST_BUDGET:
            deadline = ask.options.get("deadline_ms", self._deadline_ms)
            raise TooLateError(
                f"the deadline of {deadline:g} ms passed while the request waited {deadline - left:.0f} ms"
            )
        own = self.predictor.search.budget_ms
        return self.predictor.with_search(budget_ms=left if own is None else min(own, left))


def _predict(predictor: Predictor, ask: Ask) -> Prediction:
    options = ask.options
    named = {name: options[name] for name in ("table_height", "frame_id") if name in options}
    if ask.points is not None:
        return predictor.predict_cloud(ask.points, options.get("viewpoint"), **named)
    pose = options.get("camera_pose")
    return predictor.predict_depth(
        ask.depth,
        _matrix(options["intrinsics"]),
        pose.reshape(4, 4) if pose is not None and pose.size == 16 else pose,
        mask=ask.mask,
        level_table=options.get("level_table", False),
        **named,
    )


def _matrix(intrinsics: Float[np.ndarray, "..."]) -> Float[np.ndarray, "3 3"]:
    if intrinsics.size != 4:
        return intrinsics.reshape(3, 3)
    fx, fy, cx, cy = intrinsics
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _chosen(prediction: Prediction, ask: Ask) -> Prediction:
    """The prediction with the grasps that are asked for."""
    options = ask.options
    if "object_class" in options:
        prediction = prediction.of_class(options["object_class"])
    if "instance" in options:
        prediction = prediction.of_instance(options["instance"])
    if "region" in options:
        prediction = prediction.in_region(options["region"][:3], options["region"][3:])
    if "limit" in options:
        prediction = replace(prediction, grasps=prediction.grasps.select(slice(0, options["limit"])))
    return prediction

"""What the worker does for a pick: a prediction, and a plan for the arm that the service was started with."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from icgnet.arm.arm import Arm
from icgnet.arm.hand_eye import JOINTS, HandEye
from icgnet.arm.pick import plan_pick
from icgnet.arm.settings import DEFAULT_PICK, PickSettings
from icgnet.errors import InputError
from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.service.answers import json_bytes
from icgnet.service.bodies import Ask
from icgnet.service.predicting import Predicting

ON_ARM, BESIDE_ARM = "on the arm", "beside the arm"


@dataclass(frozen=True, eq=False)
class PickBench:
    """The arm of a service, and where its camera is. Nothing of it comes from a request.

    Attributes:
        arm: that plans are for.
        hand_eye: where the camera is; None if every request must say so with `camera_pose`.
        settings: how picks are planned.
    """

    arm: Arm
    hand_eye: HandEye | None = None
    settings: PickSettings = DEFAULT_PICK

    def __post_init__(self) -> None:
        if self.hand_eye is not None:
            self.hand_eye.pose(self.arm)  # refuses joints that are not this arm's

    @property
    def camera(self) -> str | None:
        """Where the camera is said to be: beside the arm, on the arm, or nowhere."""
        if self.hand_eye is None:
            return None
        return ON_ARM if self.hand_eye.T_base_camera is None else BESIDE_ARM

    def answering(self, predicting: Predicting, clock: Callable[[], float] = time.monotonic) -> "Picking":
        """What plans for requests."""
        return Picking(self, predicting, clock)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {
            "name": self.arm.name,
            "joint_names": list(self.arm.joint_names),
            "home": self.arm.home.tolist(),
            "T_world_base": self.arm.description.T_world_base.tolist(),
            "camera": self.camera,
            "release": self.settings.release,
        }


class Picking:
    """Plans picks for requests, in the worker's thread.

    Args:
        bench: the arm.
        predicting: finds objects and grasps.
        clock: tells the time [s].
    """

    def __init__(self, bench: PickBench, predicting: Predicting, clock: Callable[[], float]) -> None:
        self._bench = bench
        self._predicting = predicting
        self._clock = clock

    def check(self, ask: Ask) -> None:
        """Refuses what can be refused without a prediction.

        Raises:
            InputError: a cloud, no drop-off point, a camera of which nobody knows where it is, joints that are none of
                this arm, or what `Predicting.check` refuses.
        """
        if ask.depth is None:
            raise InputError("a pick needs a depth image, got a cloud")
        if "drop" not in ask.options:
            raise InputError("a pick needs drop: x,y,z of the drop-off point in the world [m]")
        self._check_camera(ask.options)
        for name in ("start", JOINTS):
            if name in ask.options:
                self._bench.arm.check_joints(ask.options[name], name)
        self._predicting.check(ask)

    def answer(self, ask: Ask, arrived: float) -> bytes:
        """The plan, what it was made of, and how long the request waited, as JSON.

        Args:
            ask: what is asked.
            arrived: when the request came, by the clock [s].

        Raises:
            InputError: the values are no scene, or the arm cannot plan there; see `Predictor` and `plan_pick`.
            TooLateError: there is no time left to begin.
        """
        options = ask.options
        arm, metrics = self._bench.arm, self._predicting.metrics
        if "camera_pose" not in options:
            ask = replace(ask, options={**options, "camera_pose": self._camera_pose(options.get(JOINTS)).ravel()})
        prediction, waited_ms = self._predicting.predict(ask, arrived)
        begun = self._clock()
        T_base_world = invert_transform(arm.description.T_world_base)
        drop = transform_points(T_base_world, options["drop"])
        plan = plan_pick(prediction, arm, T_base_world, drop, self._settings(ask, arrived), options.get("start"))
        metrics.planning.observe(self._clock() - begun)
        metrics.plans.inc(float(plan.is_found))
        found = prediction.to_dict()
        grasps = found.pop("grasps")
        picked = None if plan.grasp is None else grasps[plan.grasp]
        summary = {**found, "grasps": len(grasps)}
        service = {"waited_ms": waited_ms}
        return json_bytes({"plan": plan.to_dict(), "picked": picked, "prediction": summary, "service": service})

    def _settings(self, ask: Ask, arrived: float) -> PickSettings:
        """Those of the service, with the release that is asked for and what is left of the deadline as a budget."""
        settings = replace(self._bench.settings, release=ask.options.get("release", self._bench.settings.release))
        left = self._predicting.left_ms(ask, arrived)
        if left is None:
            return settings
        left = max(left, 1.0)
        return replace(settings, budget_ms=left if settings.budget_ms is None else min(left, settings.budget_ms))

    def _check_camera(self, options: dict[str, Any]) -> None:
        """Makes sure that somebody says where the camera is, and only one.

        Raises:
            InputError: nobody does, or two do.
        """
        if "camera_pose" in options:
            if JOINTS in options:
                raise InputError(f"{JOINTS} does not go with camera_pose: both say where the camera is")
        elif self._bench.camera is None:
            raise InputError(
                "a pick needs to know where the camera is: give camera_pose, or start the service with --hand-eye"
            )
        elif JOINTS in options and self._bench.camera != ON_ARM:
            raise InputError(f"{JOINTS} is for a camera on the arm, and that of this service stands beside it")

    def _camera_pose(self, joints: Float[np.ndarray, "j"] | None) -> Float[np.ndarray, "4 4"]:
        """T_world_camera by the hand-eye file of the service. The model of the arm is not for two threads at once."""
        arm, hand_eye = self._bench.arm, self._bench.hand_eye
        assert hand_eye is not None
        placed = hand_eye if joints is None else replace(hand_eye, joints=joints)
        return arm.description.T_world_base @ placed.pose(arm)

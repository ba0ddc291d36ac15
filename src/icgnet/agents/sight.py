"""Where objects, grasps and plans come from: a network in this process, or a service that runs elsewhere."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Int

from icgnet.agents.captures import Capture
from icgnet.arm.settings import DEFAULT_PICK, PickSettings
from icgnet.errors import InputError
from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.inference.capture import DepthCapture
from icgnet.inference.prediction import Prediction
from icgnet.predictor import Predictor

if TYPE_CHECKING:  # packages of extras
    from icgnet.arm.arm import Arm
    from icgnet.client import Client

NO_ARM = "there is no arm to plan for: icgnet mcp must be started with --arm, or with --url of a service that has one"


@dataclass(frozen=True, eq=False)
class Seen:
    """What was found in a capture.

    Attributes:
        capture: what was looked at; its camera pose is the one that was used.
        result: the entries of `result.json`.
        instance_mask: [h w] the object at each pixel, -1 for none.
        prediction: the same as values of this process; None if a service found it.
    """

    capture: Capture
    result: dict[str, Any]
    instance_mask: Int[np.ndarray, "h w"]
    prediction: Prediction | None = None


@dataclass(frozen=True)
class PickWish:
    """What shall be picked.

    Attributes:
        drop: where it is let go of: its lowest point, in the world [m].
        object_class: an object of this class only.
        instance: this object only.
        release: drop or place; None for what was said at the start.
    """

    drop: tuple[float, float, float]
    object_class: str | None = None
    instance: int | None = None
    release: str | None = None


@runtime_checkable
class Sight(Protocol):
    """Finds objects and plans picks."""

    def see(self, capture: Capture) -> Seen:
        """What is in a capture.

        Raises:
            IcgnetError: it is no scene, or the service does not answer.
        """
        ...

    def plan(self, seen: Seen, wish: PickWish) -> dict[str, Any]:
        """The entries of `plan.json`, without phases if no grasp can be carried out.

        Raises:
            IcgnetError: there is no arm, or it cannot plan there.
        """
        ...


@dataclass(frozen=True)
class Scene:
    """What was said at the start about all captures.

    Attributes:
        table_height: height of the table plane in the world [m]; None if it is to be found.
        frame: how the world is called in the result.
    """

    table_height: float | None = None
    frame: str = "world"

    def options(self, content: DepthCapture) -> dict[str, Any]:
        """Arguments of a prediction; without a pose there is no world."""
        if content.camera_pose is None:
            return {}
        return {"table_height": self.table_height, "frame_id": self.frame}


@dataclass(frozen=True, eq=False)
class Bench:
    """An arm of this process, and how it picks.

    Attributes:
        arm: that plans are for.
        settings: how picks are planned.
    """

    arm: "Arm"
    settings: PickSettings = DEFAULT_PICK


class LocalSight:
    """A network in this process.

    Args:
        predictor: finds objects and grasps.
        scene: what is known of all captures.
        bench: the arm; None if there is none.
        camera_pose: [4 4] T_world_camera of captures that do not say their own; None if it is not known.
    """

    def __init__(self, predictor: Predictor, scene: Scene, bench: Bench | None = None, camera_pose: Any = None) -> None:
        self._predictor, self._scene, self._bench, self._camera_pose = predictor, scene, bench, camera_pose

    def see(self, capture: Capture) -> Seen:
        """What the network finds in a capture.

        Raises:
            InputError: it is no scene, see `Predictor`.
        """
        content = capture.content
        if content.camera_pose is None:
            content = replace(content, camera_pose=self._camera_pose)
        prediction = self._predictor.predict_depth(
            content.depth, content.intrinsics, content.camera_pose, **self._scene.options(content)
        )
        seen = replace(capture, content=content)
        return Seen(seen, prediction.to_dict(), prediction.instance_mask, prediction)

    def plan(self, seen: Seen, wish: PickWish) -> dict[str, Any]:
        """A plan for the arm of this process.

        Raises:
            InputError: there is no arm, the pose of the camera is not known, or see `plan_pick`.
        """
        if self._bench is None:
            raise InputError(NO_ARM)
        if seen.capture.content.camera_pose is None:
            raise InputError(
                "a pick needs to know where the camera is: camera_pose in the capture, or --camera-pose or --hand-eye "
                "at the start"
            )
        from icgnet.arm.pick import plan_pick

        assert seen.prediction is not None
        arm, settings = self._bench.arm, self._bench.settings
        T_base_world = invert_transform(arm.description.T_world_base)
        if wish.release is not None:
            settings = replace(settings, release=wish.release)
        chosen = chosen_grasps(seen.prediction, wish)
        drop = transform_points(T_base_world, np.array(wish.drop))
        return plan_pick(chosen, arm, T_base_world, drop, settings).to_dict()


def chosen_grasps(prediction: Prediction, wish: PickWish) -> Prediction:
    """The prediction with the grasps that are wished for.

    Raises:
        InputError: no such object or class.
    """
    if wish.object_class is not None:
        prediction = prediction.of_class(wish.object_class)
    return prediction if wish.instance is None else prediction.of_instance(wish.instance)


class RemoteSight:
    """A service that `icgnet serve` runs; its arm and its hand-eye file are its own.

    Args:
        client: asks it.
        scene: what is known of all captures.
    """

    def __init__(self, client: "Client", scene: Scene) -> None:
        self._client, self._scene = client, scene

    def see(self, capture: Capture) -> Seen:
        """What the service finds in a capture.

        Raises:
            InputError: it refuses the capture.
            ServiceError: it does not answer.
        """
        content = capture.content
        answer = self._client.predict_depth(
            content.depth, content.intrinsics, content.camera_pose, meshes=True, **self._scene.options(content)
        )
        assert answer.instance_mask is not None
        return Seen(capture, answer.result, answer.instance_mask)

    def plan(self, seen: Seen, wish: PickWish) -> dict[str, Any]:
        """A plan for the arm of the service.

        Raises:
            InputError: it refuses the values, or an object is meant by its number and the pose of the camera is not
                known here: then the service looks anew, by its own hand-eye file, and may number objects otherwise.
            ServiceError: it does not answer, or has no arm.
        """
        content = seen.capture.content
        if wish.instance is not None and content.camera_pose is None:
            raise InputError(
                "instance_id needs camera_pose in the capture or --camera-pose at the start: the service may number "
                "objects otherwise; give object_class"
            )
        answer = self._client.pick(
            content.depth,
            content.intrinsics,
            wish.drop,
            content.camera_pose,
            object_class=wish.object_class,
            instance=wish.instance,
            release=wish.release,
            **self._scene.options(content),
        )
        return answer.result["plan"]


class LazySight:
    """Made when it is first needed: so a server of tools is there at once, and loads the network when asked to look.

    Args:
        make: the real one.
    """

    def __init__(self, make: Callable[[], Sight]) -> None:
        self._make = make
        self._made: Sight | None = None

    def see(self, capture: Capture) -> Seen:
        """See `Sight`."""
        return self._sight().see(capture)

    def plan(self, seen: Seen, wish: PickWish) -> dict[str, Any]:
        """See `Sight`."""
        return self._sight().plan(seen, wish)

    def _sight(self) -> Sight:
        if self._made is None:
            self._made = self._make()
        return self._made

"""Who looks at the workcell: the network, or one who knows the true shapes. Both say what is where by one picture."""

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

from icgnet.benchmark.config import OUR_NETWORK, WorkcellConfig
from icgnet.benchmark.planners.oracle import held_grasps, touchable
from icgnet.benchmark.workcell.station import CAMERA
from icgnet.geometry.camera import pixel_rays
from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import Gripper
from icgnet.grasping.selection import ranked
from icgnet.inference.grasp_search import GraspSearch
from icgnet.inference.prediction import NO_INSTANCE, DetectedObject, Prediction
from icgnet.inference.tabletop import TableNotFoundError
from icgnet.objects.classes import CLASSES
from icgnet.objects.object_set import ObjectSet
from icgnet.predictor import Predictor
from icgnet.sensors.config import SensorNoise
from icgnet.sensors.noise import corrupt_depth
from icgnet.simulation.camera import DepthImage, SceneRenderer
from icgnet.simulation.physics import scene_bodies
from icgnet.simulation.scene import Scene, scene_triangles

AROUND = 0.02
"""What is farther outside of the support or the workspace than this is no object [m]."""
TRIED, ENOUGH = 24, 6
"""The oracle tries so many grasps on an object, until so many hold it."""
SURE, DISTURBING = 1.0, 0.85
"""Scores of its grasps: those that hold, and those that hold but move another object."""
FETCH_GRASPS = 24
"""Grasps of each object that are asked what is in their way."""


@dataclass(frozen=True, eq=False)
class Look:
    """One picture.

    Attributes:
        scene: what stands there.
        object_set: of the scene.
        image: the picture without noise, with the true object of every pixel.
        depth: [h w] the noisy picture [m].
        T_world_camera: where the camera is.
        T_world_believed: where it is believed to be.
        rng: source of all draws.
    """

    scene: Scene
    object_set: ObjectSet
    image: DepthImage
    depth: Float[np.ndarray, "h w"]
    T_world_camera: Float[np.ndarray, "4 4"]
    T_world_believed: Float[np.ndarray, "4 4"]
    rng: np.random.Generator

    @property
    def points(self) -> Float[np.ndarray, "h w 3"]:
        """Where the pixels are believed to be [m, world]; the camera itself for those that were not measured."""
        seen = pixel_rays(CAMERA.intrinsics, self.depth.shape) * self.depth[..., None]
        return transform_points(self.T_world_believed, seen)

    def in_workspace(self) -> Bool[np.ndarray, "h w"]:
        """Which pixels are believed to be on or above the support."""
        lower, upper = self.scene.surroundings.bounds
        xy = self.points[..., :2]
        return ((xy > lower - AROUND) & (xy < upper + AROUND)).all(axis=-1) & (self.depth > 0)


def take_look(
    scene: Scene,
    object_set: ObjectSet,
    T_world_camera: Float[np.ndarray, "4 4"],
    T_world_believed: Float[np.ndarray, "4 4"],
    noise: str,
    rng: np.random.Generator,
) -> Look:
    """A picture by the camera on the wrist. The arm itself does not show in it."""
    renderer = SceneRenderer(*scene_triangles(scene, object_set), extent=scene.surroundings.extent)
    image = renderer.render(CAMERA.intrinsics, CAMERA.shape, T_world_camera)
    noisy = corrupt_depth(image, CAMERA.intrinsics, CAMERA.noise if noise == "stereo" else SensorNoise(), rng)
    depth = np.asarray(noisy.depth, np.float64)
    return Look(scene, object_set, image, depth, T_world_camera, T_world_believed, rng)


@runtime_checkable
class Eyes(Protocol):
    """Finds objects and grasps in a picture."""

    knows_walls: bool
    """Whether what stands around the objects is known without being seen."""

    def see(self, look: Look, with_blocked: bool) -> Prediction | None:
        """What is where, in the world; None if nothing can be made of the picture.

        Args:
            look: the picture.
            with_blocked: whether grasps whose hand would touch something are wanted, too.
        """
        ...


def open_eyes(config: WorkcellConfig, gripper: Gripper) -> Eyes:
    """The eyes that a benchmark names.

    Raises:
        DataError: unusable weights.
        InputError: a hand that the network does not know.
    """
    return NetworkEyes(config, gripper) if config.planner == OUR_NETWORK else TrueEyes(gripper)


class NetworkEyes:
    """The network of this package; grasps by the rule of the paper's robot."""

    knows_walls = False

    def __init__(self, config: WorkcellConfig, gripper: Gripper) -> None:
        search = GraspSearch(select="highest")
        self._gripper = gripper
        self._predictor = Predictor.load(config.weights, config.threads, config.gripper, search=search)

    def see(self, look: Look, with_blocked: bool) -> Prediction | None:
        """See `Eyes`; the table is found in the picture, as the camera's place is not known exactly."""
        search, seed = self._predictor.search, int(look.rng.integers(2**31))
        if with_blocked:
            search = replace(search, per_object=FETCH_GRASPS)
        network = self._predictor.network
        predictor = Predictor(network, self._gripper, search, seed=seed, only_free=not with_blocked)
        mask = look.in_workspace()
        if not mask.any():
            return None
        try:
            return predictor.predict_depth(look.depth, CAMERA.intrinsics, look.T_world_believed, mask=mask)
        except TableNotFoundError:
            return None


class TrueEyes:
    """Knows the true shapes and which grasps hold in a trial; only where all of it is, it knows by the camera."""

    knows_walls = True

    def __init__(self, gripper: Gripper) -> None:
        self._gripper = gripper

    def see(self, look: Look, with_blocked: bool) -> Prediction | None:
        """See `Eyes`."""
        scene, objects = look.scene, look.object_set
        T_believed_true = look.T_world_believed @ invert_transform(look.T_world_camera)
        meshes = [touchable(body).apply_transform(T_believed_true) for body in scene_bodies(scene, objects)]
        rows = np.flatnonzero((look.image.ids.ravel() >= 0) & (look.depth.ravel() > 0))
        points, owners = look.points.reshape(-1, 3)[rows], look.image.ids.ravel()[rows]
        grasps = self._grasps(look, with_blocked).transformed(T_believed_true)
        return Prediction(
            objects=tuple(
                DetectedObject(
                    index,
                    1.0,
                    objects.class_name(placed.name),
                    1.0,
                    points[owners == index],
                    lambda mesh=meshes[index]: mesh,
                )
                for index, placed in enumerate(scene.objects)
            ),
            grasps=ranked(grasps, "highest"),
            frame_id="world",
            rejected={},
            timings_ms={},
            cloud=PointCloud(points, look.T_world_believed[:3, 3], "world"),
            cloud_instances=owners.astype(np.int64),
            T_frame_table=T_believed_true,
            gripper=self._gripper,
            classes=CLASSES,
            input_rows=rows,
            input_shape=look.depth.shape,
        )

    def _grasps(self, look: Look, with_blocked: bool) -> Grasps:
        """Grasps that held in a trial; with those that are blocked, also in one as if each object stood alone."""
        scene = look.scene
        found = [self._held(scene, look, None)]
        if with_blocked:
            alone = [replace(scene, objects=(placed,)) for placed in scene.objects]
            found += [self._held(each, look, index) for index, each in enumerate(alone)]
        return Grasps.concatenate(found)

    def _held(self, scene: Scene, look: Look, index: int | None) -> Grasps:
        found = held_grasps(scene, look.object_set, self._gripper, look.rng, ENOUGH, TRIED)
        count = len(found.poses)
        return Grasps(
            poses=found.poses,
            widths=found.widths,
            openings=found.openings,
            scores=np.where(found.disturbs, DISTURBING, SURE),
            instances=found.objects if index is None else np.full(count, index),
            contacts=found.poses[:, :3, 3],
            angles=np.zeros(count, np.int64),
        )


def true_object(prediction: Prediction, instance: int, ids: Int[np.ndarray, "h w"]) -> int:
    """The object, or what else there is, that has most of the pixels of an instance; -1 if it has none."""
    under = ids[prediction.instance_mask == instance]
    values, counts = np.unique(under, return_counts=True)
    return int(values[counts.argmax()]) if len(values) else NO_INSTANCE


def instance_under(prediction: Prediction, pixels: Bool[np.ndarray, "h w"]) -> int:
    """The instance that has most of some pixels; `NO_INSTANCE` if none has any."""
    under = prediction.instance_mask[pixels]
    counts = np.bincount(under[under != NO_INSTANCE], minlength=1)
    return int(counts.argmax()) if counts.any() else NO_INSTANCE

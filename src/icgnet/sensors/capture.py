"""Depth captures of simulated scenes with their truth, for demos, examples and tests on objects not trained on."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from icgnet.geometry.camera import DEFAULT_INTRINSICS, DEFAULT_SHAPE, sphere_pose
from icgnet.geometry.workspace import CENTRE
from icgnet.objects.kinds import WIDE_KINDS, Kind, Split
from icgnet.objects.object_set import ObjectSet
from icgnet.sensors.config import NOISES, SensorNoise, exactly, up_to
from icgnet.sensors.noise import corrupt_depth
from icgnet.sensors.wide import Picture, take_wide_picture
from icgnet.simulation.camera import SceneRenderer
from icgnet.simulation.scene import Scene, scene_triangles
from icgnet.simulation.scenes import spawn_scene

ARM_LENGTH = SensorNoise(
    spots=exactly(4.0),
    disparity_step=up_to(0.1),
    flying=up_to(0.6),
    field=up_to(0.002),
)
"""What a good stereo camera at arm's length does to a depth image."""
CAPTURE_NOISES: dict[Kind, SensorNoise] = {
    "packed": ARM_LENGTH,
    "pile": ARM_LENGTH,
    "table": NOISES["stereo"],
    "bin": NOISES["stereo"],
}
"""What the sensor of a capture does."""
DEPTH_STEP = 1e-4
"""Depths are stored in steps of this [m], far below the noise; they compress better so."""


@dataclass(frozen=True, eq=False)
class SimulatedCapture:
    """A depth image of a simulated scene, and what is in it.

    Attributes:
        depth: along the camera's z axis [m], 0 where nothing was measured.
        intrinsics: camera matrix [pixels].
        camera_pose: T_world_camera; the table is at `TABLE_HEIGHT` in the world.
        ids: index of the object at each pixel, -1 for nothing, -2 for the table.
        classes: class of each object.
        scene: the objects and their poses.
    """

    depth: Float[np.ndarray, "h w"]
    intrinsics: Float[np.ndarray, "3 3"]
    camera_pose: Float[np.ndarray, "4 4"]
    ids: Int[np.ndarray, "h w"]
    classes: tuple[str, ...]
    scene: Scene

    def save(self, path: Path) -> None:
        """Writes an npz that `icgnet predict` reads: depth, K, camera_pose, and the truth as ids and classes."""
        np.savez_compressed(
            path,
            depth=(np.round(self.depth / DEPTH_STEP) * DEPTH_STEP).astype(np.float32),
            K=self.intrinsics,
            camera_pose=self.camera_pose,
            ids=self.ids.astype(np.int8),
            classes=np.array(self.classes),
        )


def simulate_capture(
    kind: Kind,
    object_set: ObjectSet,
    split: Split,
    rng: np.random.Generator,
    objects: int = 5,
    polar_deg: tuple[float, float] = (35.0, 50.0),
    noise: SensorNoise | None = None,
) -> SimulatedCapture:
    """A capture of a random scene by a noisy camera: at arm's length, or one that sees a whole table or bin.

    Args:
        kind: of the scene.
        object_set: where the objects come from.
        split: which of its objects.
        rng: source of every draw.
        objects: how many to try to place.
        polar_deg: least and largest angle of the camera from the vertical [degrees]; not of tables and bins.
        noise: of the sensor; what is usual for the kind of scene if None.
    """
    scene = spawn_scene(kind, object_set, split, rng, objects)
    if kind in WIDE_KINDS:
        picture = take_wide_picture(scene, object_set, rng)
    else:
        target = np.array([CENTRE[0], CENTRE[1], 0.10])
        polar, azimuth = np.deg2rad(rng.uniform(*polar_deg)), rng.uniform(0.0, 2.0 * np.pi)
        pose = sphere_pose(target, rng.uniform(0.55, 0.65), polar, azimuth)
        renderer = SceneRenderer(*scene_triangles(scene, object_set), extent=scene.surroundings.extent)
        picture = Picture(renderer.render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, pose), DEFAULT_INTRINSICS, pose)
    depth = corrupt_depth(picture.image, picture.intrinsics, noise or CAPTURE_NOISES[kind], rng).depth
    classes = tuple(object_set.class_name(placed.name) for placed in scene.objects)
    return SimulatedCapture(depth, picture.intrinsics, picture.T_world_camera, picture.image.ids, classes, scene)

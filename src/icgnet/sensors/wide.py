"""Pictures of whole tables and bins: where the camera stands, and what it would see without errors."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from icgnet.geometry.camera import sphere_pose
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.objects.kinds import Kind
from icgnet.objects.object_set import ObjectSet
from icgnet.sensors.config import CAMERAS
from icgnet.simulation.camera import DepthImage, SceneRenderer
from icgnet.simulation.scene import Scene, scene_triangles
from icgnet.simulation.surroundings import Surroundings

WIDE_CAMERA = CAMERAS["d435_vga"]
"""Sees tables and bins, whatever the noise is."""
WIDE_POLAR_DEG: dict[Kind, tuple[float, float]] = {"table": (20.0, 55.0), "bin": (0.0, 35.0)}
"""How far from the vertical it stands [degrees]."""
NEAREST, PER_EDGE = 0.5, 0.6
"""Distance from the middle of the support: the first [m], and the second times the support's longer edge."""
PLACES = 30
"""Cameras that are drawn until one sees enough; else the one that sees most is taken."""
SEEN_PIXELS, SEEN_SHARE = 20, 0.5
"""An object with so many pixels is seen; so many of the objects must be."""


@dataclass(frozen=True, eq=False)
class Picture:
    """What an ideal camera sees of a scene.

    Attributes:
        image: true depth [m] and object ids.
        intrinsics: camera matrix [pixels].
        T_world_camera: pose of the camera.
    """

    image: DepthImage
    intrinsics: Float[np.ndarray, "3 3"]
    T_world_camera: Float[np.ndarray, "4 4"]


def take_wide_picture(scene: Scene, object_set: ObjectSet, rng: np.random.Generator) -> Picture:
    """A picture of a table or bin by a camera that is drawn.

    From so far that all is seen but the corners of large tables, and from where at least half of the objects are seen,
    which walls and posts may hide.

    Args:
        scene: what stands there.
        object_set: of the scene.
        rng: source of the draws.
    """
    renderer = SceneRenderer(*scene_triangles(scene, object_set), extent=scene.surroundings.extent)
    pictures: list[tuple[int, Picture]] = []
    while len(pictures) < PLACES:
        pose = draw_wide_camera(scene.kind, scene.surroundings, rng)
        image = renderer.render(WIDE_CAMERA.intrinsics, WIDE_CAMERA.shape, pose)
        pixels = np.bincount(image.ids[image.ids >= 0], minlength=len(scene.objects))
        seen = int((pixels >= SEEN_PIXELS).sum())
        pictures.append((seen, Picture(image, WIDE_CAMERA.intrinsics, pose)))
        if seen >= SEEN_SHARE * len(scene.objects):
            break
    return max(pictures, key=lambda each: each[0])[1]


def draw_wide_camera(kind: Kind, surroundings: Surroundings, rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    """T_world_camera of a camera that looks at the middle of a table or bin; draws polar angle and azimuth."""
    lower, upper = surroundings.bounds
    middle = np.array([*(lower + upper) / 2, TABLE_HEIGHT])
    radius = NEAREST + PER_EDGE * float((upper - lower).max())
    polar, azimuth = np.deg2rad(rng.uniform(*WIDE_POLAR_DEG[kind])), rng.uniform(0.0, 2.0 * np.pi)
    return sphere_pose(middle, radius, polar, azimuth)

"""What a camera sees of a scene: the picture, the sensor's errors, and the cloud of what stands on the table."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from icgnet.geometry.camera import unproject
from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.geometry.tsdf import TRUNCATION_VOXELS, fuse
from icgnet.geometry.workspace import SIZE, TABLE_HEIGHT, TABLE_MARGIN, above_table
from icgnet.sensors.config import SensorNoise
from icgnet.sensors.noise import corrupt_depth, corrupt_points
from icgnet.simulation.camera import DepthImage, SceneRenderer
from icgnet.training.config import Sampling
from icgnet.training.placements import Placement
from icgnet.training.sample import NOTHING
from icgnet.training.views import CameraView, crop_view, draw_view

TSDF_RESOLUTION = 180
"""Voxels along an edge of the workspace, as in the published evaluation."""
OWNER_DISTANCE = TRUNCATION_VOXELS * SIZE / TSDF_RESOLUTION
"""A point farther than this in depth from what the pixels around it show belongs to nobody [m]."""


@dataclass(frozen=True, eq=False)
class Exposure:
    """A depth image without errors, where it was taken, and whether its cloud is to come from a distance grid."""

    image: DepthImage
    view: CameraView
    fused: bool

    def seen_from(self, T_a_b: Float[np.ndarray, "4 4"]) -> "Exposure":
        """The same picture with the camera's pose, given in frame b, in frame a."""
        return replace(self, view=replace(self.view, T_world_camera=T_a_b @ self.view.T_world_camera))


@dataclass(frozen=True, eq=False)
class SensedCloud:
    """A cloud without the table, in the frame of the picture's camera pose [m].

    Attributes:
        points: [n 3] positions.
        owners: [n] index of the object each belongs to; below 0 for none.
        viewpoint: [3] centre of the camera.
    """

    points: Float[np.ndarray, "n 3"]
    owners: Int[np.ndarray, "n"]
    viewpoint: Float[np.ndarray, "3"]


def take_picture(placements: list[Placement], sampling: Sampling, rng: np.random.Generator) -> Exposure:
    """A picture of the objects and some table around them, by a camera that is drawn, in the world."""
    triangles = [each.to_world(each.assets.triangles) for each in placements]
    lower = np.min([part.min(axis=(0, 1)) for part in triangles], axis=0)
    upper = np.max([part.max(axis=(0, 1)) for part in triangles], axis=0)
    # Table beyond this margin would be removed anyway, but some of it must be seen, since some of it stays.
    margin = np.array([1.0, 1.0, 0.0]) * rng.uniform(0.01, 0.05)
    kind = rng.random()
    fused = kind >= 1.0 - sampling.tsdf
    resolution = 0.5 if kind < (1.0 - sampling.tsdf) * sampling.half_resolution else 1.0
    view = crop_view(draw_view(sampling.views, resolution, rng), lower - margin, upper + margin)
    owners = np.repeat(np.arange(len(triangles)), [len(part) for part in triangles])
    renderer = SceneRenderer(np.concatenate(triangles), owners)
    return Exposure(renderer.render(view.intrinsics, view.shape, view.T_world_camera), view, fused)


def observe(picture: Exposure, sampling: Sampling, rng: np.random.Generator) -> SensedCloud:
    """The cloud that a sensor with errors makes of a picture, cut off above the table."""
    table_height = TABLE_HEIGHT + rng.uniform(-1, 1) * sampling.table_jitter
    return sense(picture, sampling.noise, table_height, rng)


def sense(picture: Exposure, noise: SensorNoise, table_height: float, rng: np.random.Generator) -> SensedCloud:
    """The same for a certain sensor, and a table that is removed at a certain height [m]."""
    view, noise = picture.view, noise.pick(rng)
    image = corrupt_depth(picture.image, view.intrinsics, noise, rng)
    points, owners = _fused_points(image, view, table_height) if picture.fused else _pixel_points(image, view)
    standing = above_table(points, table_height)
    points, index = corrupt_points(points[standing], noise, rng)
    return SensedCloud(points, owners[standing][index], view.T_world_camera[:3, 3])


def _pixel_points(image: DepthImage, view: CameraView) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
    """Points of the measured pixels [m], and the object of each."""
    measured = image.depth > 0
    if not measured.any():
        return np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    points = unproject(image.depth, view.intrinsics)[measured]
    return transform_points(view.T_world_camera, points), np.asarray(image.ids, np.int64)[measured]


def _fused_points(
    image: DepthImage, view: CameraView, table_height: float
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
    """Points [m] on the zero crossing of the distance grid, and the object of each."""
    # Points just above the cut need the voxels just below it.
    lowest = table_height + TABLE_MARGIN - 2 * SIZE / TSDF_RESOLUTION
    grid = fuse([image.depth], [view.intrinsics], [view.T_world_camera], TSDF_RESOLUTION, least_height=lowest)
    points = grid.surface_points()
    points = points[above_table(points, table_height)]
    return points, _shown_ids(image, view, points)


def _shown_ids(image: DepthImage, view: CameraView, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "n"]:
    """For each point [m] the id at its pixel, or at the one of the nine around it whose depth is the most like its own.

    The neighbours are asked where the pixel itself is off by more than a voxel.
    """
    in_camera = transform_points(invert_transform(view.T_world_camera), points)
    column, row = np.rint((in_camera @ view.intrinsics.T)[:, :2] / in_camera[:, 2:]).astype(int).T
    ids, least = _ids_at(image, row, column, in_camera[:, 2])
    doubtful = np.flatnonzero(least > OWNER_DISTANCE / TRUNCATION_VOXELS)
    for down, right in np.ndindex(3, 3):
        there = (row[doubtful] + down - 1, column[doubtful] + right - 1)
        other, distance = _ids_at(image, *there, in_camera[doubtful, 2])
        better = distance < least[doubtful]
        ids[doubtful[better]], least[doubtful[better]] = other[better], distance[better]
    return np.where(least < OWNER_DISTANCE, ids, NOTHING)


def _ids_at(
    image: DepthImage, row: Int[np.ndarray, "n"], column: Int[np.ndarray, "n"], depth: Float[np.ndarray, "n"]
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Ids at pixels (the nearest ones of the image), and how far the depth there is from the given one [m]."""
    height, width = image.depth.shape
    pixel = np.clip(row, 0, height - 1) * width + np.clip(column, 0, width - 1)
    return image.ids.ravel()[pixel], np.abs(image.depth.ravel()[pixel] - depth)

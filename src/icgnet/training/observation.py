"""What a camera sees of a scene: the picture, the sensor's errors, and the cloud of what stands on the table."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from icgnet.geometry.cells import CellGrid
from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.geometry.tsdf import TRUNCATION_VOXELS, fuse
from icgnet.geometry.workspace import CENTRE, SIZE, TABLE_HEIGHT, TABLE_MARGIN, above_table
from icgnet.sensors.config import CAMERAS, SensorNoise
from icgnet.sensors.noise import corrupt_depth, corrupt_points
from icgnet.simulation.camera import DepthImage, SceneRenderer
from icgnet.simulation.surroundings import Surroundings
from icgnet.training.config import Sampling, ViewRange
from icgnet.training.placements import Placement, stands_in
from icgnet.training.sample import NOTHING
from icgnet.training.views import CameraView, crop_view, draw_pose, draw_view

TSDF_RESOLUTION = 180
"""Voxels along an edge of the workspace, as in the published evaluation."""
OWNER_DISTANCE = TRUNCATION_VOXELS * SIZE / TSDF_RESOLUTION
"""A point farther than this in depth from what the pixels around it show belongs to nobody [m]."""

NEAREST = 0.2
"""What is nearer to the camera, because it stands in front of or inside something, is not measured [m]."""
FINEST = 0.0009
"""Distance of neighbouring points below which cameras average pixels, as users of cameras at arm's length do [m]."""
ROUNDINGS = 1e-4
"""Single precision puts no point farther off than this [m]."""
HEADROOM = 0.02
"""Errors of sensors lift no point higher than this above the highest thing [m]."""
NEARBY = 0.3
"""Objects of wide scenes that begin farther than this beyond the crop are not in it and hide nothing [m]."""


@dataclass(frozen=True, eq=False)
class Exposure:
    """A depth image without errors, and what becomes of it.

    Attributes:
        image: what the camera sees.
        view: where it was taken.
        fused: whether its cloud is to come from a distance grid.
        noise: what the sensor does.
    """

    image: DepthImage
    view: CameraView
    fused: bool
    noise: SensorNoise

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
    image = renderer.render(view.intrinsics, view.shape, view.T_world_camera)
    return Exposure(image, view, fused, sampling.noise)


def take_crop(
    placements: list[Placement],
    surroundings: Surroundings,
    views: tuple[ViewRange, ...],
    T_work_world: Float[np.ndarray, "4 4"],
    region: CellGrid,
    sampling: Sampling,
    rng: np.random.Generator,
) -> Exposure:
    """A picture of what lies in a region of a wide scene, by a camera that is drawn, in the world; never fused.

    Args:
        placements: the objects of the whole scene; those far away are left out.
        surroundings: of the scene.
        views: where the camera may stand around the middle of the workspace.
        T_work_world: where in the world the workspace is.
        region: in its frame.
        sampling: names the cameras.
        rng: source of the draws.
    """
    middle = transform_points(invert_transform(T_work_world), CENTRE[None])[0, :2]
    camera = CAMERAS[sampling.cameras[rng.integers(len(sampling.cameras))]]
    view = _binned(CameraView(draw_pose(views, middle, rng), camera.intrinsics, camera.shape), middle)
    near = {
        index: each
        for index, each in enumerate(placements)
        if np.linalg.norm(each.T_world_object[:2, 3] - middle) < 0.5 * (region.end[0] - region.origin[0]) + NEARBY
    }
    # The table's edge and the floor are cut off with the table.
    standing = [each for each in surroundings.structures if each.corners[:, 2].max() > TABLE_HEIGHT]
    in_work = replace(view, T_world_camera=T_work_world @ view.T_world_camera)
    everything = [each.corners() for each in near.values()] + [each.corners for each in standing]
    lower = np.array([*region.origin[:2], TABLE_HEIGHT])
    upper = np.array([*region.end[:2], _top(everything, T_work_world, region)])
    cropped = crop_view(in_work, lower, upper)
    view = replace(cropped, T_world_camera=view.T_world_camera)
    triangles = {
        index: each.to_world(each.assets.triangles) for index, each in near.items() if view.may_show(each.corners())
    }
    renderer = SceneRenderer(
        np.concatenate([np.zeros((0, 3, 3)), *triangles.values()]),
        np.repeat(np.array(list(triangles), int), [len(each) for each in triangles.values()]),
        extent=surroundings.extent,
        structures=[each for each in standing if view.may_show(each.corners)],
    )
    image = renderer.render(view.intrinsics, view.shape, view.T_world_camera)
    too_near = image.depth < NEAREST
    image = DepthImage(np.where(too_near, np.float32(0.0), image.depth), np.where(too_near, NOTHING, image.ids))
    return Exposure(image, view, False, camera.noise)


def _top(things: list[Float[np.ndarray, "_ 3"]], T_work_world: Float[np.ndarray, "4 4"], region: CellGrid) -> float:
    """Height [m] above which nothing is in the region, whatever the sensor's errors are.

    Args:
        things: points around each thing, world frame [m].
        T_work_world: where in the world the workspace is.
        region: in its frame.
    """
    in_work = [transform_points(T_work_world, points) for points in things]
    tops = [float(points[:, 2].max()) for points in in_work if stands_in(points, region)]
    return min(max(tops, default=TABLE_HEIGHT) + HEADROOM, region.end[2])


def _binned(view: CameraView, middle: Float[np.ndarray, "2"]) -> CameraView:
    """The camera with every few pixels taken together where they are finer than the network can make use of."""
    distance = float(np.linalg.norm(view.T_world_camera[:3, 3] - [*middle, TABLE_HEIGHT]))
    factor = max(1, int(np.ceil(FINEST * float(view.intrinsics[0, 0]) / distance)))
    intrinsics = view.intrinsics / [[factor], [factor], [1.0]]
    return CameraView(view.T_world_camera, intrinsics, (view.shape[0] // factor, view.shape[1] // factor))


def observe(picture: Exposure, sampling: Sampling, rng: np.random.Generator) -> SensedCloud:
    """The cloud that a sensor with errors makes of a picture, cut off above the table."""
    table_height = TABLE_HEIGHT + rng.uniform(-1, 1) * sampling.table_jitter
    return sense(picture, picture.noise, table_height, rng)


def sense(picture: Exposure, noise: SensorNoise, table_height: float, rng: np.random.Generator) -> SensedCloud:
    """The same for a certain sensor, and a table that is removed at a certain height [m]."""
    view, noise = picture.view, noise.pick(rng)
    image = corrupt_depth(picture.image, view.intrinsics, noise, rng)
    find_points = _fused_points if picture.fused else _pixel_points
    points, owners = find_points(image, view, table_height)
    points, index = corrupt_points(points, noise, rng)
    return SensedCloud(points, owners[index], view.T_world_camera[:3, 3])


def _pixel_points(
    image: DepthImage, view: CameraView, table_height: float
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
    """Points of the measured pixels [m] above the table, and the object of each."""
    (fx, skew, cx), (_, fy, cy), _ = view.intrinsics
    # Most pixels show the table: their heights alone, a little too low for the roundings, tell which ones do not.
    by_column, by_row, constant = view.T_world_camera[2, :3] @ np.linalg.inv(view.intrinsics)
    height, width = image.depth.shape
    along_row = (by_column * np.arange(width) + constant).astype(np.float32)
    slopes = along_row + (by_row * np.arange(height)).astype(np.float32)[:, None]
    lowest = np.float32(table_height + TABLE_MARGIN - ROUNDINGS - view.T_world_camera[2, 3])
    row, column = np.nonzero((image.depth > 0) & (image.depth * slopes > lowest))
    depth = image.depth[row, column].astype(np.float64)
    y = (row - cy) / fy
    in_camera = np.stack([(column - cx - skew * y) / fx * depth, y * depth, depth], axis=1)
    points, owners = transform_points(view.T_world_camera, in_camera), np.asarray(image.ids, np.int64)[row, column]
    standing = above_table(points, table_height)
    return points[standing], owners[standing]


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

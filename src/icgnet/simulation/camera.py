"""A depth camera without OpenGL: rays against visual meshes, the table as a plane, an object id for every pixel."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from icgnet.geometry.camera import check_intrinsics, pixel_rays
from icgnet.geometry.rays import ray_scene
from icgnet.geometry.transforms import check_transform
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.simulation.scene import BACKGROUND, NOTHING, TABLE
from icgnet.simulation.surroundings import Structure

FAR = 2.0  # the camera measures nothing beyond this depth [m]


@dataclass(frozen=True, eq=False)
class DepthImage:
    """What the camera sees.

    Attributes:
        depth: [h w] distance along the optical axis [m], 0 where nothing is seen.
        ids: [h w] index of the object, `TABLE`, `BACKGROUND` or `NOTHING`.
    """

    depth: Float[np.ndarray, "h w"]
    ids: Int[np.ndarray, "h w"]


class SceneRenderer:
    """Renders one scene from any number of cameras."""

    def __init__(
        self,
        triangles: Float[np.ndarray, "t 3 3"],
        owners: Int[np.ndarray, "t"],
        table_height: float | None = TABLE_HEIGHT,
        extent: tuple[float, float, float, float] | None = None,
        structures: Sequence[Structure] = (),
    ) -> None:
        """Builds the ray-tracing structure.

        Args:
            triangles: corners in the world frame [m]; see `icgnet.simulation.scene.scene_triangles`.
            owners: object index of each triangle.
            table_height: height of the table plane [m], None for no table.
            extent: of the table, see `icgnet.simulation.surroundings.Surroundings`; None for a table without end.
            structures: convex things that show as `BACKGROUND`. As triangles they would give the same picture; their
                planes need no rays.
        """
        triangles = np.asarray(triangles, np.float32)
        self._owners = np.asarray(owners, np.int64)
        self._table_height, self._extent = table_height, extent
        self._structures = [(each.corners.astype(np.float64), each.planes()) for each in structures]
        self._corners = triangles.reshape(-1, 3).astype(np.float64)
        # Where the corners of each thing begin: triangles of one owner come one after the other.
        self._starts = 3 * np.append(0, np.flatnonzero(np.diff(self._owners)) + 1)
        self._scene = ray_scene(triangles)

    def render(
        self, intrinsics: Float[np.ndarray, "3 3"], shape: tuple[int, int], T_world_camera: Float[np.ndarray, "4 4"]
    ) -> DepthImage:
        """Depth and object ids from one camera.

        Args:
            intrinsics: camera matrix [pixels].
            shape: height and width of the image [pixels].
            T_world_camera: camera pose (x right, y down, z forward).

        Raises:
            InputError: intrinsics or pose are not usable.
        """
        pose = check_transform(T_world_camera, "T_world_camera")
        intrinsics = check_intrinsics(intrinsics)
        # Rays have z = 1 in the camera frame, so the distance that embree counts in ray lengths is the depth.
        rays = _camera_rays(intrinsics.tobytes(), shape)
        depth, ids = self._table_depth(rays @ pose[2, :3].astype(np.float32), float(pose[2, 3]))
        if self._extent is not None:
            self._cut_table(depth, ids, rays, pose)
        for corners, planes in self._structures:
            _add_structure(depth, ids, corners, planes, intrinsics, pose)
        window, worth = self._window(intrinsics, shape, pose)
        directions = rays[window] @ pose[:3, :3].T.astype(np.float32)
        distances, owners = self._hits(pose[:3, 3], directions[worth])
        in_front = distances < depth[window][worth]
        row, column = (index[in_front] for index in np.nonzero(worth))
        depth[window][row, column], ids[window][row, column] = distances[in_front], owners[in_front]
        unseen = depth > FAR
        depth[unseen], ids[unseen] = 0.0, NOTHING
        return DepthImage(depth, ids)

    def _table_depth(
        self, slopes: Float[np.ndarray, "h w"], height: float
    ) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"]]:
        """Depth (inf for none) and ids of an empty table, for rays that climb by `slopes` [m] a metre of depth."""
        if self._table_height is None:
            return np.full(slopes.shape, np.inf, np.float32), np.full(slopes.shape, NOTHING)
        with np.errstate(divide="ignore"):
            depth = np.float32(self._table_height - height) / slopes
        depth[depth <= 0.0] = np.inf
        return depth, np.where(np.isfinite(depth), TABLE, NOTHING)

    def _cut_table(
        self,
        depth: Float[np.ndarray, "h w"],
        ids: Int[np.ndarray, "h w"],
        rays: Float[np.ndarray, "h w 3"],
        pose: Float[np.ndarray, "4 4"],
    ) -> None:
        """Takes away what of the table plane lies beyond the table's edges."""
        lower_x, lower_y, upper_x, upper_y = self._extent or (0.0, 0.0, 0.0, 0.0)
        with np.errstate(invalid="ignore"):
            x, y = (pose[axis, 3] + depth * (rays @ pose[axis, :3].astype(np.float32)) for axis in (0, 1))
            beyond = ~((x >= lower_x) & (x <= upper_x) & (y >= lower_y) & (y <= upper_y))
        depth[beyond], ids[beyond] = np.inf, NOTHING

    def _window(
        self, intrinsics: Float[np.ndarray, "3 3"], shape: tuple[int, int], pose: Float[np.ndarray, "4 4"]
    ) -> tuple[tuple[slice, slice], Bool[np.ndarray, "r c"]]:
        """Rows and columns that can show a triangle, and which pixels there: most of a picture is table, without rays.

        A pixel can show a thing within the rectangle around that thing's corners in the picture, and everywhere if the
        thing reaches behind the camera.
        """
        points = (self._corners - pose[:3, 3]) @ pose[:3, :3]
        if len(points) == 0:
            return (slice(0, 0), slice(0, 0)), np.zeros((0, 0), bool)
        if points[:, 2].min() <= 1e-3:
            whole = slice(0, shape[0]), slice(0, shape[1])
            return whole, np.ones(shape, bool)
        pixels = points @ intrinsics.T
        columns, rows = pixels[:, 0] / pixels[:, 2], pixels[:, 1] / pixels[:, 2]
        height, width = shape
        worth = np.zeros(shape, bool)
        of_things = (_intervals(rows, self._starts, height), _intervals(columns, self._starts, width))
        for window in zip(*of_things, strict=True):
            worth[window] = True
        whole = _intervals(rows, np.zeros(1, int), height)[0], _intervals(columns, np.zeros(1, int), width)[0]
        return whole, worth[whole]

    def _hits(
        self, eye: Float[np.ndarray, "3"], rays: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n"], Int[np.ndarray, "n"]]:
        """Depth (inf for none) and owner of the nearest triangle on each ray."""
        depth, ids = np.full(len(rays), np.inf, np.float32), np.full(len(rays), NOTHING)
        if len(rays):
            origins = np.broadcast_to(eye.astype(np.float32), rays.shape)
            hits = self._scene.run(np.ascontiguousarray(origins), rays, output=True)
            is_hit = hits["primID"] >= 0
            depth[is_hit] = hits["tfar"][is_hit]
            ids[is_hit] = self._owners[hits["primID"][is_hit]]
        return depth, ids


def _add_structure(
    depth: Float[np.ndarray, "h w"],
    ids: Int[np.ndarray, "h w"],
    corners: Float[np.ndarray, "n 3"],
    planes: Float[np.ndarray, "e 4"],
    intrinsics: Float[np.ndarray, "3 3"],
    pose: Float[np.ndarray, "4 4"],
) -> None:
    """Puts a convex thing into the picture where nothing nearer is.

    A ray enters it where it has passed the last of the planes that have the camera in front of them, if it has not left
    by another one before. The inverse depth at which rays meet a plane is linear in the pixels, so that there is
    nothing to divide by.
    """
    points = (corners - pose[:3, 3]) @ pose[:3, :3]
    rows, columns = slice(0, depth.shape[0]), slice(0, depth.shape[1])
    if points[:, 2].max() <= 1e-3:
        return
    if points[:, 2].min() > 1e-3:
        pixels = points @ intrinsics.T
        whole = np.zeros(1, int)
        rows, columns = (_intervals(pixels[:, axis] / pixels[:, 2], whole, depth.shape[1 - axis])[0] for axis in (1, 0))
    in_front = planes[:, :3] @ pose[:3, 3] + planes[:, 3]
    # Exactly in a plane counts as just in front of it.
    in_front[np.abs(in_front) < 1e-9] = 1e-9
    slopes = planes[:, :3] @ pose[:3, :3] @ np.linalg.inv(intrinsics) / -in_front[:, None]
    by_column = (slopes[:, 0:1] * np.arange(columns.start, columns.stop) + slopes[:, 2:]).astype(np.float32)
    by_row = (slopes[:, 1:2] * np.arange(rows.start, rows.stop)).astype(np.float32)
    shape = (rows.stop - rows.start, columns.stop - columns.start)
    entered, left = np.full(shape, np.inf, np.float32), np.zeros(shape, np.float32)
    for is_in_front, across, down in zip(in_front > 0, by_column, by_row, strict=True):
        if is_in_front:
            np.minimum(entered, across + down[:, None], out=entered)
        else:
            np.maximum(left, across + down[:, None], out=left)
    # From inside, what is seen is where the ray leaves.
    inverse = np.where(left <= entered, entered, np.float32(0.0)) if (in_front > 0).any() else left
    near = depth[rows, columns]
    row, column = np.nonzero(inverse > 1 / near)
    near[row, column] = 1 / inverse[row, column]
    ids[rows, columns][row, column] = BACKGROUND


def _intervals(values: Float[np.ndarray, "n"], starts: Int[np.ndarray, "k"], limit: int) -> list[slice]:
    """The pixels between the least and the largest of the values from each start on, of an image's `limit` pixels."""
    first = np.maximum(np.floor(np.minimum.reduceat(values, starts)), 0).astype(int)
    last = np.minimum(np.ceil(np.maximum.reduceat(values, starts)) + 1, limit).astype(int)
    return [slice(each, max(each, end)) for each, end in zip(first.tolist(), last.tolist(), strict=True)]


@lru_cache(maxsize=8)
def _camera_rays(intrinsics: bytes, shape: tuple[int, int]) -> Float[np.ndarray, "h w 3"]:
    rays = pixel_rays(np.frombuffer(intrinsics).reshape(3, 3), shape).astype(np.float32)
    rays.setflags(write=False)
    return rays

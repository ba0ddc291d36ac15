"""Which parts of a scene the camera has seen to be free, and which are hidden.

The points become a small depth image from their viewpoint; every cell of a grid is then compared with the surface on
its ray. The same function serves training and inference.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Float32, Int

from icgnet.geometry.camera import look_at
from icgnet.geometry.cells import PITCH, WORKSPACE_CELLS, CellGrid
from icgnet.geometry.workspace import TABLE_HEIGHT

PIXEL = 0.004
"""Edge of a pixel of the depth image at the distance of the middle of the grid [m]."""
LARGEST_IMAGE = 640
"""Edge of the depth image at most [pixels]; cells outside of it count as hidden."""
FILL_COUNT = 4
"""An empty pixel with this many measured neighbours is a hole in a surface. At a straight edge there are three."""


def visibility_grid(
    points: Float[np.ndarray, "n 3"],
    viewpoint: Float[np.ndarray, "3"],
    grid: CellGrid = WORKSPACE_CELLS,
    table_height: float = TABLE_HEIGHT,
    truncation: float = 0.03,
) -> Float32[np.ndarray, "x y z"]:
    """Projective signed distance of every cell centre from the surface on its ray, in units of the truncation.

    1 is free space in front of the surface, 0 the surface, -1 what it hides, linear between. Where nothing was
    measured the ray goes on to the table. Cells behind the camera or far off its axis count as hidden.

    Args:
        points: what the camera measured, table frame [m]; with or without the points of the table.
        viewpoint: camera centre, table frame [m].
        grid: the cells.
        table_height: height of the table plane [m].
        truncation: distance at which the value reaches 1 or -1 [m].

    Raises:
        InputError: the viewpoint is the middle of the grid.
    """
    half = 0.5 * PITCH * np.array(grid.shape)
    view = _VirtualCamera.towards(half + np.array(grid.origin), viewpoint, float(np.linalg.norm(half)))
    surface = _range_image(view, points).ravel()
    rays = _cell_centres(grid) - view.centre
    distance = _length(rays)
    pixel = view.pixel_index(rays)
    measured = np.where(pixel >= 0, surface[pixel], -np.inf)
    reached = np.minimum(measured, distance * _table_ratio(rays[:, 2], float(table_height - viewpoint[2])))
    value = np.clip((reached - distance) / truncation, -1.0, 1.0)
    return value.astype(np.float32).reshape(grid.shape)


@dataclass(frozen=True, eq=False)
class _VirtualCamera:
    """A pinhole camera with a square image that looks at a scene.

    Attributes:
        centre: its position, table frame [m].
        axes: directions of right, down and forward as columns, table frame.
        focal: focal length [pixels].
        half: pixels on each side of the one in the middle.
    """

    centre: Float32[np.ndarray, "3"]
    axes: Float32[np.ndarray, "3 3"]
    focal: float
    half: int

    @staticmethod
    def towards(target: Float[np.ndarray, "3"], viewpoint: Float[np.ndarray, "3"], radius: float) -> "_VirtualCamera":
        """The camera at `viewpoint` [m] that sees the sphere with this radius [m] around `target` [m]."""
        axes = look_at(viewpoint, target)[:3, :3]
        distance = np.linalg.norm(target - viewpoint)
        focal = distance / PIXEL
        # Tangent to the sphere; a camera inside of it would need an endless image.
        spread = radius / np.sqrt(distance**2 - radius**2) if distance > radius else np.inf
        half = int(min(np.ceil(focal * spread), LARGEST_IMAGE // 2))
        return _VirtualCamera(viewpoint.astype(np.float32), axes.astype(np.float32), float(focal), half)

    def pixel_index(self, rays: Float32[np.ndarray, "n 3"]) -> Int[np.ndarray, "n"]:
        """Flat index of the pixel that each ray from the centre goes through, -1 outside of the image."""
        x, y, depth = self.axes.T @ rays.T
        ahead = depth > 1e-3
        scale = np.float32(self.focal) / np.where(ahead, depth, np.float32(1.0))
        column = np.rint(x * scale).astype(np.int64)
        row = np.rint(y * scale).astype(np.int64)
        inside = ahead & (np.abs(column) <= self.half) & (np.abs(row) <= self.half)
        return np.where(inside, (row + self.half) * (2 * self.half + 1) + column + self.half, -1)


def _range_image(view: _VirtualCamera, points: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "h w"]:
    """Distance of the nearest point in each pixel [m], infinite where there is none; small holes are filled."""
    edge = 2 * view.half + 1
    image = np.full(edge * edge, np.inf, dtype=np.float32)
    rays = points.astype(np.float32) - view.centre
    pixel = view.pixel_index(rays)
    seen = pixel >= 0
    np.minimum.at(image, pixel[seen], _length(rays)[seen])
    image = image.reshape(edge, edge)
    measured = np.isfinite(image)
    holes = ~measured & (_over_neighbours(np.add, measured.astype(np.int8)) >= FILL_COUNT)
    image[holes] = _over_neighbours(np.minimum, image)[holes]
    return image


def _length(vectors: Float32[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n"]:
    x, y, z = vectors.T
    return np.sqrt(x * x + y * y + z * z)


def _over_neighbours(combine: np.ufunc, image: np.ndarray) -> np.ndarray:
    """`combine` over the 3 x 3 neighbourhood of every pixel, one axis after the other."""
    for axis in (0, 1):
        result = image.copy()
        lower, upper = [slice(None)] * 2, [slice(None)] * 2
        lower[axis], upper[axis] = slice(None, -1), slice(1, None)
        combine(result[tuple(upper)], image[tuple(lower)], out=result[tuple(upper)])
        combine(result[tuple(lower)], image[tuple(upper)], out=result[tuple(lower)])
        image = result
    return image


def _table_ratio(ray_heights: Float32[np.ndarray, "n"], table: float) -> Float[np.ndarray, "n"]:
    """How many times its length a ray must go to reach the table; infinite if it never does.

    Args:
        ray_heights: vertical component of each ray [m].
        table: height of the table above the viewpoint [m]; usually negative.
    """
    towards = ray_heights * table > 0
    return np.where(towards, table / np.where(towards, ray_heights, 1.0), np.inf)


@lru_cache(maxsize=4)
def _cell_centres(grid: CellGrid) -> Float32[np.ndarray, "n 3"]:
    """Centres of all cells [m], the last axis fastest."""
    axes = [
        (np.arange(first, first + count, dtype=np.float32) + 0.5) * np.float32(PITCH)
        for first, count in zip(grid.lower, grid.shape, strict=True)
    ]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    centres.setflags(write=False)
    return centres

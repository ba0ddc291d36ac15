"""A small ray caster: triangles on a table, with soft shadows and see-through surfaces, on any CPU.

No display, no OpenGL: rays go through embree, everything else is numpy. A picture is drawn at twice its size and
averaged, in bands of rows that stay in the cache.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.ndimage import uniform_filter

from icgnet.geometry.camera import pixel_rays
from icgnet.geometry.rays import ray_scene
from icgnet.viewer.triangles import Triangles
from icgnet.viewer.view import Perspective

SUPERSAMPLING = 2
BAND_ROWS = 32
LAYERS = 10
"""How many surfaces a line of sight goes through before the rest is left out."""
STEP = 2e-5
"""Gap [m] that keeps a ray from hitting the surface that it starts on."""
SHADOW_STEP = 1.5e-3
"""The same for shadow rays: more than the discs of a cloud stand out of their surface."""

AMBIENT, SKY, KEY, FILL = 0.38, 0.22, 0.62, 0.16
LAMP_SPREAD = 0.07
"""Half edge of the lamp as seen from the scene, as a slope: the width of the soft border of a shadow."""
SHADOW_ON_TABLE = 0.34
"""Share of the light that the table loses in full shadow."""

TABLE_COLOUR = 0.985
GRID_PITCH = 0.05
GRID_DARKNESS = 0.05
GRID_WIDTH = 0.0009


@dataclass(frozen=True)
class TableSurface:
    """The table that the triangles stand on: it fades to paper away from `centre`.

    Attributes:
        height: z of the plane, world frame [m].
        centre: x, y of the middle of what is drawn [m].
        radius: distance from there at which nothing of it is left [m].
    """

    height: float
    centre: tuple[float, float]
    radius: float


def render(
    triangles: Triangles, table: TableSurface | None, view: Perspective, shape: tuple[int, int]
) -> UInt8[np.ndarray, "h w 3"]:
    """The picture of triangles on a table, on white.

    Args:
        triangles: what is drawn, world frame (z up); may be empty.
        table: None for no table.
        view: where from.
        shape: height and width [pixels].
    """
    height, width = shape
    caster = _Caster(triangles, view)
    rays = pixel_rays(view.intrinsics(shape), shape).astype(np.float32)
    ground = np.ones(shape, np.float32) if table is None else caster.table(table, rays, _lamp_of_each_sample(shape))
    below = -np.inf if table is None else table.height

    fine = (height * SUPERSAMPLING, width * SUPERSAMPLING)
    rays = pixel_rays(view.intrinsics(fine), fine).astype(np.float32)
    lamps = _lamp_of_each_sample(fine)
    picture = np.empty((height, width, 3), np.float32)
    for band in _bands(height):
        samples = slice(band.start * SUPERSAMPLING, band.stop * SUPERSAMPLING)
        light, remaining = caster.surfaces(rays[samples].reshape(-1, 3), lamps[samples].ravel(), below)
        light, remaining = light.reshape(-1, fine[1], 3), remaining.reshape(-1, fine[1], 1)
        picture[band] = _pixel_means(light) + _pixel_means(remaining) * ground[band, :, None]
    return (255.0 * _encode(picture) + 0.5).astype(np.uint8)


def _pixel_means(samples: Float[np.ndarray, "fh fw c"]) -> Float[np.ndarray, "h w c"]:
    total = np.zeros_like(samples[::SUPERSAMPLING, ::SUPERSAMPLING])
    for i in range(SUPERSAMPLING):
        for j in range(SUPERSAMPLING):
            total += samples[i::SUPERSAMPLING, j::SUPERSAMPLING]
    return total / np.float32(SUPERSAMPLING**2)


def _bands(height: int) -> list[slice]:
    return [slice(top, min(top + BAND_ROWS, height)) for top in range(0, height, BAND_ROWS)]


# Which of the 4 x 4 points of the lamp a sample asks: the four samples of a pixel ask one in each row and each column
# of the lamp, and neighbouring pixels ask different ones, so that the border of a shadow is soft without a pattern.
_LAMP_TILE = np.array([[0, 6, 1, 7], [9, 15, 8, 14], [2, 4, 3, 5], [11, 13, 10, 12]])


def _lamp_of_each_sample(shape: tuple[int, int]) -> Int[np.ndarray, "h w"]:
    side = len(_LAMP_TILE)
    return np.tile(_LAMP_TILE, (-(-shape[0] // side), -(-shape[1] // side)))[: shape[0], : shape[1]]


def _decode(colour: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Linear light of sRGB values (the 2.2 power law)."""
    return np.power(colour, 2.2, dtype=np.float32)


def _encode(light: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """The sRGB values of linear light."""
    return np.power(np.clip(light, 0.0, 1.0), 1 / 2.2, dtype=np.float32)


class _Caster:
    """Light along lines of sight; one scene, one camera."""

    def __init__(self, triangles: Triangles, view: Perspective) -> None:
        self.corners = triangles.corners.astype(np.float32)
        self.normals = triangles.normals.astype(np.float32)
        self.albedo = _decode(triangles.colours.astype(np.float32))
        self.opacity = triangles.opacities.astype(np.float32)
        self.scene = ray_scene(self.corners)
        self.eye = view.T_world_camera[:3, 3].astype(np.float32)
        self.R_world_camera = view.T_world_camera[:3, :3].astype(np.float32)
        self._hang_lamps()

    def _hang_lamps(self) -> None:
        """The lamp hangs behind the left shoulder of the camera; the fill light comes from the right."""
        right, backward = self.R_world_camera[:, 0], -self.R_world_camera[:, 2]
        back = _unit(backward * (1, 1, 0) + 1e-6 * right)
        up = np.array([0.0, 0.0, 1.0])
        self.key = _unit(-0.55 * right + 0.25 * back + 1.1 * up).astype(np.float32)
        self.fill = _unit(0.9 * right + 0.6 * back + 0.35 * up).astype(np.float32)
        across = _unit(np.cross(self.key, up))
        u, v = np.meshgrid(np.linspace(-1, 1, 4), np.linspace(-1, 1, 4))
        offsets = u.reshape(-1, 1) * across + v.reshape(-1, 1) * np.cross(self.key, across)
        self.lamp = _unit(self.key + LAMP_SPREAD * offsets).astype(np.float32)

    def table(
        self, table: TableSurface, rays: Float[np.ndarray, "h w 3"], lamps: Int[np.ndarray, "h w"]
    ) -> Float[np.ndarray, "h w"]:
        """Linear light (grey) of the table and the paper around it, without what stands on it."""
        points = self._meet(table.height, rays)
        strength = _strength(points, table)
        row, column = np.nonzero(strength)
        near = points[row, column]
        offset = near - self.eye
        footprint = np.sqrt(np.einsum("rd,rd->r", offset, offset)) * np.linalg.norm(rays[0, 0] - rays[0, 1])
        bright = np.ones(rays.shape[:2], np.float32)
        bright[row, column] = (TABLE_COLOUR - GRID_DARKNESS * _grid(near, footprint)) ** 2.2
        lit = np.ones(rays.shape[:2], np.float32)
        lit[row, column] = self._lit(near, lamps[row, column])
        soft = uniform_filter(lit, size=len(_LAMP_TILE), mode="nearest")
        return 1.0 + strength * (bright * (1.0 - SHADOW_ON_TABLE * (1.0 - soft)) - 1.0)

    def _meet(self, height: float, rays: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w 3"]:
        """Where rays from the eye meet the plane at this height, infinitely far if they do not."""
        directions = rays @ self.R_world_camera.T
        drop = np.float32(height - self.eye[2])
        with np.errstate(divide="ignore"):
            distance = drop / directions[..., 2]
        distance[distance <= 0] = np.float32(1e6)
        return self.eye + distance[..., None] * directions

    def surfaces(
        self, rays: Float[np.ndarray, "r 3"], lamps: Int[np.ndarray, "r"], below: float
    ) -> tuple[Float[np.ndarray, "r 3"], Float[np.ndarray, "r"]]:
        """Light of the surfaces that rays (camera frame) meet, and the share that goes on to what is behind them.

        Surfaces `below` this height [m] are not seen.
        """
        light = np.zeros_like(rays)
        remaining = np.ones(len(rays), np.float32)
        if not len(self.corners):
            return light, remaining
        directions = rays @ self.R_world_camera.T
        which = np.arange(len(rays))
        origins = np.broadcast_to(self.eye, directions.shape)
        for _ in range(LAYERS):
            hit = self._hits(origins, directions)
            points = origins[hit.rays] + hit.distance[:, None] * directions[hit.rays]
            hit, points = hit.select(points[:, 2] > below), points[points[:, 2] > below]
            which, directions = which[hit.rays], directions[hit.rays]
            if not len(which):
                break
            shade, opacity = self._shade(points, directions, hit, lamps[which])
            light[which] += (remaining[which] * opacity)[:, None] * shade
            remaining[which] *= 1.0 - opacity
            through = remaining[which] > 0.01
            which, directions = which[through], directions[through]
            origins = points[through] + STEP * directions
        return light, remaining

    def _hits(self, origins: Float[np.ndarray, "r 3"], directions: Float[np.ndarray, "r 3"]) -> "_Hits":
        result = self.scene.run(np.ascontiguousarray(origins), directions, output=True)
        rays = np.flatnonzero(result["primID"] >= 0)
        return _Hits(rays, result["primID"][rays], result["tfar"][rays], result["u"][rays], result["v"][rays])

    def _lit(self, points: Float[np.ndarray, "r 3"], lamps: Int[np.ndarray, "r"]) -> Bool[np.ndarray, "r"]:
        """Whether nothing stands between the points and the lamp."""
        if not len(points) or not len(self.corners):
            return np.ones(len(points), bool)
        towards = self.lamp[lamps]
        return self.scene.run(points + SHADOW_STEP * towards, towards, query="OCCLUDED") != 0

    def _shade(
        self,
        points: Float[np.ndarray, "r 3"],
        directions: Float[np.ndarray, "r 3"],
        hit: "_Hits",
        lamps: Int[np.ndarray, "r"],
    ) -> tuple[Float[np.ndarray, "r 3"], Float[np.ndarray, "r"]]:
        """Light and opacity of surfaces; the far sides of see-through ones are left out."""
        weights = np.stack([1.0 - hit.u - hit.v, hit.u, hit.v], axis=1)
        normals = _unit(np.einsum("rk,rkd->rd", weights, self.normals[hit.triangle]))
        away = np.einsum("rd,rd->r", normals, directions) > 0
        normals[away] *= -1
        opacity = self.opacity[hit.triangle]
        opacity = np.where(away & (opacity < 1.0), np.float32(0.0), opacity)
        key = np.clip(normals @ self.key, 0.0, 1.0)
        facing = np.flatnonzero((key > 0) & (opacity > 0))
        lit = np.zeros(len(key), bool)
        lit[facing] = self._lit(points[facing] + SHADOW_STEP * normals[facing], lamps[facing])
        brightness = AMBIENT + SKY * (0.5 + 0.5 * normals[:, 2]) + FILL * np.clip(normals @ self.fill, 0.0, 1.0)
        brightness += KEY * key * lit
        return self.albedo[hit.triangle] * brightness[:, None], opacity


def _strength(points: Float[np.ndarray, "h w 3"], table: TableSurface) -> Float[np.ndarray, "h w"]:
    """How much of the table is left at its points: 1 near the centre, 0 from the radius on."""
    x, y = points[..., 0] - np.float32(table.centre[0]), points[..., 1] - np.float32(table.centre[1])
    ramp = np.clip(1.25 - (1.25 / table.radius) * np.sqrt(x * x + y * y), 0.0, 1.0)
    return ramp * ramp * (3.0 - 2.0 * ramp)


def _grid(points: Float[np.ndarray, "r 3"], footprint: Float[np.ndarray, "r"]) -> Float[np.ndarray, "r"]:
    """How much of each pixel on the table is covered by a grid line, given the width of a pixel there [m]."""
    to_line = GRID_PITCH * np.abs((points[:, :2] / GRID_PITCH + 0.5) % 1.0 - 0.5).min(axis=1)
    return np.clip(0.5 + (GRID_WIDTH / 2 - to_line) / footprint, 0.0, 1.0) * np.minimum(1.0, GRID_WIDTH / footprint)


@dataclass(frozen=True, eq=False)
class _Hits:
    """Which rays meet which triangles, how far away [ray lengths] and where on them (barycentric)."""

    rays: Int[np.ndarray, "r"]
    triangle: Int[np.ndarray, "r"]
    distance: Float[np.ndarray, "r"]
    u: Float[np.ndarray, "r"]
    v: Float[np.ndarray, "r"]

    def select(self, which: Bool[np.ndarray, "r"]) -> "_Hits":
        return _Hits(self.rays[which], self.triangle[which], self.distance[which], self.u[which], self.v[which])


def _unit(vectors: Float[np.ndarray, "*r 3"]) -> Float[np.ndarray, "*r 3"]:
    length = np.sqrt(np.einsum("...d,...d->...", vectors, vectors))
    # The normals of triangles without an area are zero, and stay it.
    return vectors / np.maximum(length, 1e-12)[..., None]

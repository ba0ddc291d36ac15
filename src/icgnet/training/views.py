"""Where the camera stands at a training visit, and the part of its image that is worth rendering."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from icgnet.geometry.camera import DEFAULT_INTRINSICS, DEFAULT_SHAPE, sphere_pose
from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.geometry.workspace import CENTRE
from icgnet.training.config import ViewRange

NEAREST = 0.05
"""What reaches nearer to the camera's plane than this may be anywhere in the image, or beside it [m]."""


@dataclass(frozen=True, eq=False)
class CameraView:
    """A pinhole camera in the world with the size of its image."""

    T_world_camera: Float[np.ndarray, "4 4"]
    intrinsics: Float[np.ndarray, "3 3"]
    shape: tuple[int, int]

    def may_show(self, corners: Float[np.ndarray, "n 3"]) -> bool:
        """Whether the image may show a part of the convex hull of some points [m, world frame]."""
        in_camera = transform_points(invert_transform(self.T_world_camera), corners)
        if in_camera[:, 2].min() < NEAREST:
            return bool(in_camera[:, 2].max() >= NEAREST)
        pixels = (in_camera @ self.intrinsics.T)[:, :2] / in_camera[:, 2:]
        limit = np.array([self.shape[1], self.shape[0]])
        return bool((pixels.min(axis=0) < limit).all() and (pixels.max(axis=0) > -1.0).all())


def draw_view(ranges: tuple[ViewRange, ...], resolution: float, rng: np.random.Generator) -> CameraView:
    """A camera with the default intrinsics that looks at the middle of the workspace.

    Args:
        ranges: where cameras may stand.
        resolution: factor on the default 640 x 480 pixels.
        rng: source of the draws.
    """
    pose = draw_pose(ranges, CENTRE[:2], rng)
    intrinsics = DEFAULT_INTRINSICS.copy()
    intrinsics[:2] *= resolution
    height, width = DEFAULT_SHAPE
    return CameraView(pose, intrinsics, (round(height * resolution), round(width * resolution)))


def draw_pose(
    ranges: tuple[ViewRange, ...], place: Float[np.ndarray, "2"], rng: np.random.Generator
) -> Float[np.ndarray, "4 4"]:
    """T_world_camera of a camera in one of the ranges around a place, given by x and y [m]."""
    shares = np.array([each.share for each in ranges])
    chosen = ranges[rng.choice(len(ranges), p=shares / shares.sum())]
    target = np.array([*place, rng.uniform(*chosen.target)])
    polar = np.deg2rad(rng.uniform(*chosen.polar_deg))
    return sphere_pose(target, rng.uniform(*chosen.radius), polar, rng.uniform(0, 2 * np.pi))


def crop_view(view: CameraView, lower: Float[np.ndarray, "3"], upper: Float[np.ndarray, "3"]) -> CameraView:
    """The same camera with only the pixels that can see into a box; the whole image if it stands in or beside it.

    Args:
        view: the camera.
        lower: least corner of the box, world frame [m].
        upper: largest corner of the box, world frame [m].
    """
    corners = np.array(np.meshgrid(*zip(lower, upper, strict=True))).reshape(3, 8).T
    in_camera = transform_points(invert_transform(view.T_world_camera), corners)
    if in_camera[:, 2].min() < NEAREST:
        return view
    pixels = (in_camera @ view.intrinsics.T)[:, :2] / in_camera[:, 2:]
    limit = np.array([view.shape[1], view.shape[0]])
    # At least two pixels either way, so that a picture has slopes.
    first = np.clip(np.floor(pixels.min(axis=0)), 0, limit - 2).astype(int)
    last = np.clip(np.ceil(pixels.max(axis=0)) + 1, first + 2, limit).astype(int)
    intrinsics = view.intrinsics.copy()
    intrinsics[:2, 2] -= first
    return CameraView(view.T_world_camera, intrinsics, (int(last[1] - first[1]), int(last[0] - first[0])))

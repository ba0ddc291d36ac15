"""Where a picture is drawn from."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from icgnet.geometry.camera import sphere_pose
from icgnet.geometry.transforms import invert_transform, transform_points

FOCAL_LENGTH = 2.2
"""In image heights: a long lens (26 degrees), so that boxes look like boxes."""


@dataclass(frozen=True, eq=False)
class Perspective:
    """A pinhole camera without a resolution.

    Attributes:
        T_world_camera: its pose; camera x right, y down, z forward.
        focal_length: in image heights.
    """

    T_world_camera: Float[np.ndarray, "4 4"]
    focal_length: float = FOCAL_LENGTH

    def intrinsics(self, shape: tuple[int, int]) -> Float[np.ndarray, "3 3"]:
        """The camera matrix [pixels] of an image of this height and width."""
        height, width = shape
        focal = self.focal_length * height
        return np.array([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])

    def project(self, points: Float[np.ndarray, "n 3"], shape: tuple[int, int]) -> Float[np.ndarray, "n 2"]:
        """Pixel (u, v) of points [m, world] in front of the camera."""
        seen = transform_points(invert_transform(self.T_world_camera), points)
        homogeneous = seen @ self.intrinsics(shape).T
        return homogeneous[:, :2] / homogeneous[:, 2:]


def framing_view(
    points: Float[np.ndarray, "n 3"],
    azimuth: float,
    elevation: float,
    shape: tuple[int, int],
    margin: float = 0.12,
) -> Perspective:
    """A view from this direction, as near as it can be with all points inside of the margins.

    Args:
        points: what must be seen, world frame [m]; at least one.
        azimuth: where the camera stands, about world z from world x [rad].
        elevation: how far above the horizon it stands [rad].
        shape: height and width of the image.
        margin: free share of the image on each side.
    """
    height, width = shape
    rotation = sphere_pose(np.zeros(3), 1.0, np.pi / 2 - elevation, azimuth)[:3, :3]
    seen = points @ rotation
    # Half of the field of view as a slope, in x and y: a point at depth z must have |x| <= slope * z.
    slope = (0.5 - margin) / FOCAL_LENGTH * np.array([width / height, 1.0])
    # The lines of sight along the upper and lower borders of the picture touch the points; they meet at the camera.
    high = (seen[:, :2] - slope * seen[:, 2:]).max(axis=0)
    low = (seen[:, :2] + slope * seen[:, 2:]).min(axis=0)
    depth = -((high - low) / (2 * slope)).max()
    # In the other axis there is room left: the points go to the middle of it.
    eye = np.array([*((high + low) / 2), min(depth, seen[:, 2].min() - 0.1)])
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = rotation @ eye
    return Perspective(pose)

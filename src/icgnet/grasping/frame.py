"""From a contact to grasp poses: the twelve approach angles around a surface normal.

Paper: "Grasp Representation". A contact point c with outward normal n spans a reference frame with y0 = n,
x0 along z_world x n and z0 = x0 x y0; turning it about y0 by an approach angle gives one grasp orientation, whose
third column is the approach direction. At 0 degrees a grasp on a vertical wall comes from straight above.
"""

import numpy as np
from jaxtyping import Float

from icgnet.geometry.transforms import make_transform

APPROACH_ANGLES = np.deg2rad(-90.0 + np.arange(12) * 180.0 / 11.0)
"""The approach angles [rad]: twelve from -90 to 90 degrees."""
SINGULAR_COSINE = 0.98
"""|z_world . n| above which the normal counts as vertical and x0 comes from world x instead."""


def contact_frames(normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """The reference frames at contacts, with columns x0, y0 = normal, z0.

    Args:
        normals: outward surface normals, world frame (z up); scaled to length 1, so that single precision is enough.
    """
    y = np.asarray(normals, float)
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    vertical = np.abs(y[:, 2]) > SINGULAR_COSINE
    x = np.cross([0.0, 0.0, 1.0], y)
    x[vertical] = np.array([1.0, 0.0, 0.0]) - y[vertical, :1] * y[vertical]
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def grasp_rotations(normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n a 3 3"]:
    """The grasp orientations at contacts, one for each approach angle: closing axis +y = normal, approach +z."""
    c, s, zero, one = np.cos(APPROACH_ANGLES), np.sin(APPROACH_ANGLES), np.zeros(12), np.ones(12)
    about_y = np.stack([c, zero, s, zero, one, zero, -s, zero, c], axis=-1).reshape(12, 3, 3)
    return contact_frames(normals)[:, None] @ about_y


def grasp_poses(
    contacts: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    widths: Float[np.ndarray, "n"],
    finger_reach: float = 0.010,
) -> Float[np.ndarray, "n a 4 4"]:
    """T_world_grasp for every contact and approach angle.

    Paper: eq. 2 and 3. Differs: the origin is midway between the finger tips when they touch the object,
    p = c - (w/2) n + d a, so that closing does not push the object; the published labels put one finger 6 mm off.

    Args:
        contacts: contact points c, world frame [m].
        normals: outward unit normals n there, world frame.
        widths: object width w between the finger tips [m].
        finger_reach: how far d the tips reach past the contact along the approach a [m].
    """
    rotations = grasp_rotations(normals)
    centres = np.asarray(contacts) - 0.5 * np.asarray(widths)[:, None] * normals
    return make_transform(rotations, centres[:, None] + finger_reach * rotations[..., 2])

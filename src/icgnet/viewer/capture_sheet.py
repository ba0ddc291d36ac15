"""A real frame in two panels: what is labelled in it, and what the predictor makes of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image, ImageDraw

from icgnet.geometry.transforms import transform_points
from icgnet.grasping.grasps import Grasps
from icgnet.viewer.describe import best_per_object
from icgnet.viewer.palette import instance_colour, instance_colours, score_colours, to_bytes
from icgnet.viewer.sheet import NOTHING

PANEL_WIDTH = 640
"""Of each of the two panels [pixels]."""
OPAQUE = 0.6
"""How much a mask hides of the picture below it."""
CLICK_RADIUS = 5
"""Of the dots that show clicks [pixels]."""
MOST_GRASPS = 12
FINGER, STEM = 0.04, 0.03
"""Lengths of the lines that stand for the fingers and the hand behind them [m]."""
NEAREST = 0.01
"""What is nearer to the camera is not drawn [m]."""


@dataclass(frozen=True, eq=False)
class CaptureView:
    """A frame, and what is labelled in it.

    Attributes:
        depth: distance along the camera's z axis [m], NaN where nothing was measured.
        intrinsics: camera matrix [pixels].
        colour: in the size of the depth image; the depth is drawn in grey if None.
        labels: object of each pixel from 1 on, 0 for none; None if there are only clicks.
        clicks: pixels (u, v) on each object.
        others: pixels (u, v) on none.
    """

    depth: Float[np.ndarray, "h w"]
    intrinsics: Float[np.ndarray, "3 3"]
    colour: UInt8[np.ndarray, "h w 3"] | None
    labels: Int[np.ndarray, "h w"] | None
    clicks: Sequence[Int[np.ndarray, "_ 2"]]
    others: Int[np.ndarray, "n 2"]


def draw_capture(view: CaptureView, instances: Int[np.ndarray, "h w"], grasps: Grasps) -> Image.Image:
    """Labels or clicks on the left; on the right the predicted objects, and the best grasp of the best of them.

    Args:
        view: the frame.
        instances: predicted object of each pixel, -1 for none.
        grasps: camera frame.
    """
    picture = grey_depth(view.depth) if view.colour is None else view.colour
    scale = PANEL_WIDTH / picture.shape[1]
    left = _panel(picture if view.labels is None else with_masks(picture, view.labels - 1))
    pen = ImageDraw.Draw(left)
    for u, v in scale * view.others:
        pen.line([u - 4, v - 4, u + 4, v + 4], fill="white", width=2)
        pen.line([u - 4, v + 4, u + 4, v - 4], fill="white", width=2)
    for number, pixels in enumerate(view.clicks):
        for u, v in scale * pixels:
            box = [u - CLICK_RADIUS, v - CLICK_RADIUS, u + CLICK_RADIUS, v + CLICK_RADIUS]
            pen.ellipse(box, fill=to_bytes(instance_colour(number)), outline="white")
    right = _panel(with_masks(picture, instances))
    _draw_hands(right, best_per_object(grasps, 1).select(slice(0, MOST_GRASPS)), view.intrinsics, scale)
    both = Image.new("RGB", (2 * PANEL_WIDTH, left.height))
    both.paste(left, (0, 0))
    both.paste(right, (PANEL_WIDTH, 0))
    return both


def grey_depth(depth: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """A depth image [m] in grey, near is bright; not measured is light."""
    measured = np.isfinite(depth) & (depth > 0)
    image = np.full((*depth.shape, 3), NOTHING, dtype=np.uint8)
    if measured.any():
        near, far = np.percentile(depth[measured], [1, 99])
        nearness = np.clip((far - depth[measured]) / max(far - near, 1e-6), 0.0, 1.0)
        image[measured] = np.round(40 + 170 * nearness).astype(np.uint8)[:, None]
    return image


def with_masks(picture: UInt8[np.ndarray, "h w 3"], instances: Int[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """A picture with the pixels of objects (from 0 on) in their colours, and a white line around each."""
    shown = picture.copy()
    there = instances >= 0
    colours = 255 * instance_colours(instances[there])
    shown[there] = np.round((1 - OPAQUE) * picture[there] + OPAQUE * colours).astype(np.uint8)
    edges = np.zeros(instances.shape, dtype=bool)
    edges[:-1] |= instances[:-1] != instances[1:]
    edges[:, :-1] |= instances[:, :-1] != instances[:, 1:]
    shown[edges] = 255
    return shown


def _panel(picture: UInt8[np.ndarray, "h w 3"]) -> Image.Image:
    height = round(PANEL_WIDTH * picture.shape[0] / picture.shape[1])
    return Image.fromarray(picture).resize((PANEL_WIDTH, height))


def _draw_hands(image: Image.Image, grasps: Grasps, intrinsics: Float[np.ndarray, "3 3"], scale: float) -> None:
    """Draws two fingers, the line between them and a stem for each grasp, in the colour of its score."""
    pen = ImageDraw.Draw(image)
    for pose, opening, colour in zip(grasps.poses, grasps.openings, score_colours(grasps.scores), strict=True):
        half = float(opening) / 2
        corners = [[0, half, 0], [0, half, -FINGER], [0, -half, -FINGER], [0, -half, 0]]
        line = transform_points(pose, np.array([*corners, [0, 0, -FINGER], [0, 0, -FINGER - STEM]]))
        if (line[:, 2] < NEAREST).any():
            continue
        pixels = line @ intrinsics.T
        ends = [(float(u), float(v)) for u, v in scale * pixels[:, :2] / pixels[:, 2:]]
        red, green, blue = (float(value) for value in colour)
        for width, fill in ((6, (255, 255, 255)), (3, to_bytes((red, green, blue)))):
            pen.line(ends[:4], fill=fill, width=width, joint="curve")
            pen.line(ends[4:], fill=fill, width=width)

"""Pictures of real frames show labels, predicted objects and hands where they are."""

import numpy as np
import pytest

from icgnet.geometry.transforms import make_transform
from icgnet.grasping.grasps import Grasps
from icgnet.viewer.capture_sheet import PANEL_WIDTH, CaptureView, draw_capture, grey_depth
from icgnet.viewer.palette import instance_colour

SHAPE = (60, 80)
K = np.array([[80.0, 0.0, 40.0], [0.0, 80.0, 30.0], [0.0, 0.0, 1.0]])
NOBODY = np.full(SHAPE, -1)
NO_CLICKS = np.zeros((0, 2), dtype=np.int64)


def view(labels=None, clicks=(), others=NO_CLICKS, colour=None) -> CaptureView:
    return CaptureView(np.full(SHAPE, 0.8), K, colour, labels, clicks, others)


def hand_at(*centre: float) -> Grasps:
    """A hand whose fingers point away from the camera, opened by 8 cm across the picture's rows."""
    pose = make_transform(np.eye(3), np.array(centre))
    one = np.ones(1)
    return Grasps(pose[None], 0.07 * one, 0.08 * one, 0.9 * one, np.zeros(1, int), pose[None, :3, 3], np.zeros(1, int))


def panels(picture) -> tuple[np.ndarray, np.ndarray]:
    image = np.asarray(picture).astype(int)
    return image[:, :PANEL_WIDTH], image[:, PANEL_WIDTH:]


def test_masks_are_drawn_in_the_colours_of_their_objects():
    mask = NOBODY.copy()
    mask[20:40, 20:40] = 2
    left, right = panels(draw_capture(view(mask + 1), mask, Grasps.empty()))
    assert left.shape == (PANEL_WIDTH * 60 // 80, PANEL_WIDTH, 3)
    np.testing.assert_array_equal(left, right)
    plain = panels(draw_capture(view(), NOBODY, Grasps.empty()))[0]
    changed = np.abs(left - plain).sum(axis=2) > 30
    assert changed[240, 240]
    assert not changed[:100].any()
    # Towards the colour of the object, not just anywhere.
    colour = 255 * np.array(instance_colour(2))
    assert np.abs(left[240, 240] - colour).sum() < np.abs(plain[240, 240] - colour).sum()


def test_clicks_and_crosses_are_drawn_on_the_left_only():
    plain, _ = panels(draw_capture(view(), NOBODY, Grasps.empty()))
    left, right = panels(
        draw_capture(view(clicks=[np.array([[10, 20]])], others=np.array([[70, 50]])), NOBODY, Grasps.empty())
    )
    changed = np.abs(left - plain).sum(axis=2) > 0
    assert changed[160, 80]
    assert changed[400, 560]
    assert changed.sum() < 300
    np.testing.assert_array_equal(right, plain)


def test_a_hand_is_drawn_where_the_camera_sees_it():
    plain, _ = panels(draw_capture(view(), NOBODY, Grasps.empty()))
    _, right = panels(draw_capture(view(), NOBODY, hand_at(0.2, 0.0, 0.8)))
    v, u = np.nonzero(np.abs(right - plain).sum(axis=2) > 0)
    # 0.2 m to the right at 0.8 m are 20 pixels of 80, drawn eight times as large.
    assert 8 * 58 < u.mean() < 8 * 63
    assert v.mean() == pytest.approx(8 * 30, abs=12)
    assert np.ptp(v) > 8 * 8
    np.testing.assert_array_equal(panels(draw_capture(view(), NOBODY, hand_at(0.2, 0.0, 0.02)))[1], plain)


def test_the_colour_image_is_shown_if_there_is_one():
    red = np.zeros((*SHAPE, 3), dtype=np.uint8)
    red[..., 0] = 200
    assert (panels(draw_capture(view(colour=red), NOBODY, Grasps.empty()))[0] == [200, 0, 0]).all()


def test_depth_is_bright_where_it_is_near_and_light_grey_where_it_is_not_known():
    depth = np.array([[0.5, 1.0, np.nan, 0.0]])
    grey = grey_depth(depth)[0, :, 0]
    assert grey[0] > grey[1]
    assert grey[2] == grey[3] == 235
    assert grey_depth(np.full((2, 2), np.nan)).min() == 235

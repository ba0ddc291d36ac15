"""Depth in metres from the images of ROS."""

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="needs icgnet[ros2]")

from icgnet.errors import InputError
from icgnet.ros2.images import depth_of, intrinsics_of
from icgnet.ros2.messages import CameraInfo, Header, Image, RegionOfInterest

DEPTH = np.array([[0.0, 0.5, 1.25], [0.75, 65.535, 0.001]])
K = [600.0, 0.0, 320.0, 0.0, 610.0, 240.0, 0.0, 0.0, 1.0]


def image(pixels: np.ndarray, encoding: str, step: int | None = None, is_bigendian: int = 0) -> Image:
    height, width = pixels.shape
    row = pixels.itemsize * width
    rows = np.zeros((height, step or row), np.uint8)
    rows[:, :row] = np.ascontiguousarray(pixels).view(np.uint8).reshape(height, row)
    return Image(Header(), height, width, encoding, is_bigendian, step or row, rows.ravel().tolist())


@pytest.mark.parametrize("encoding", ["16UC1", "mono16"])
@pytest.mark.parametrize("is_bigendian", [0, 1])
@pytest.mark.parametrize("step", [None, 10])
def test_millimetres(encoding, is_bigendian, step):
    pixels = (1000 * DEPTH).round().astype(">u2" if is_bigendian else "<u2")
    np.testing.assert_allclose(depth_of(image(pixels, encoding, step, is_bigendian)), DEPTH, atol=1e-9)


@pytest.mark.parametrize("is_bigendian", [0, 1])
def test_metres_and_nan(is_bigendian):
    depth = DEPTH.copy()
    depth[0, 0] = np.nan
    pixels = depth.astype(">f4" if is_bigendian else "<f4")
    np.testing.assert_allclose(depth_of(image(pixels, "32FC1", 16, is_bigendian)), depth, rtol=1e-6)


def test_an_encoding_that_is_no_depth_is_refused():
    with pytest.raises(InputError, match="encoding 'rgb8' of the image is no depth; known are 16UC1"):
        depth_of(image(np.zeros((2, 3), np.uint8), "rgb8"))


@pytest.mark.parametrize(
    "broken", [{"height": 3}, {"width": 4}, {"step": 5}, {"data": []}, {"width": 0}, {"height": 0}]
)
def test_an_image_that_is_not_as_large_as_it_says_is_refused(broken):
    wrong = image(np.ones((2, 3), np.uint16), "16UC1")
    vars(wrong).update(broken)
    with pytest.raises(InputError, match="cannot have"):
        depth_of(wrong)


def test_the_camera_matrix():
    np.testing.assert_array_equal(intrinsics_of(CameraInfo(height=480, width=640, k=K), 640, 480).ravel(), K)


def test_of_rectified_images_the_matrix_is_in_P():
    P = [500.0, 0.0, 310.0, -25.0, 0.0, 505.0, 235.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    found = intrinsics_of(CameraInfo(height=480, width=640, k=K, p=P), 640, 480)
    np.testing.assert_array_equal(found, [[500, 0, 310], [0, 505, 235], [0, 0, 1]])


def test_binning_and_region_are_as_in_image_geometry():
    roi = RegionOfInterest(x_offset=40, y_offset=20, height=400, width=500)
    info = CameraInfo(height=480, width=640, k=K, binning_x=2, binning_y=4, roi=roi)
    found = intrinsics_of(info, 250, 100)
    np.testing.assert_allclose(found, [[300.0, 0.0, 140.0], [0.0, 152.5, 55.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("k", "size", "said"),
    [
        ([0.0] * 9, (640, 480), "K of the camera info is zero"),
        (K, (320, 240), "the camera info is for 640 x 480 pixels, the image has 320 x 240"),
        ([-1.0, *K[1:]], (640, 480), "intrinsics|focal"),
        ([float("nan"), *K[1:]], (640, 480), "intrinsics|finite"),
    ],
)
def test_a_camera_info_that_does_not_fit_is_refused(k, size, said):
    with pytest.raises(InputError, match=said):
        intrinsics_of(CameraInfo(height=480, width=640, k=k), *size)

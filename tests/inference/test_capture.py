"""Inputs from files."""

import json
import zlib

import numpy as np
import pytest
import scipy.io
import trimesh
from PIL import Image

from icgnet.errors import DataError, InputError
from icgnet.geometry.camera import look_at
from icgnet.geometry.clouds import PointCloud
from icgnet.inference.capture import (
    DepthCapture,
    read_camera_pose,
    read_capture,
    read_intrinsics,
    read_mask,
)

K = np.array([[600.0, 0.0, 320.0], [0.0, 610.0, 240.0], [0.0, 0.0, 1.0]])
POSE = look_at(np.array([0.1, -0.4, 0.5]), np.array([0.15, 0.15, 0.05]))
NUMBERS = ("600", "610", "320", "240")


@pytest.fixture
def millimetres(tmp_path):
    path = tmp_path / "depth.png"
    Image.fromarray(np.full((48, 64), 515, dtype=np.uint16)).save(path)
    return path


def write_calibration(folder, kind):
    """A calibration file of each kind that is in use."""
    path = folder / f"camera.{kind.split('-')[0]}"
    if kind == "json":
        path.write_text(json.dumps({"K": K.tolist()}))
    elif kind == "json-matrix":
        path.write_text(json.dumps(K.tolist()))
    elif kind == "json-focal":
        path.write_text(json.dumps({"fx": 600, "fy": 610, "ppx": 320, "ppy": 240}))
    elif kind == "json-open3d":
        path.write_text(json.dumps({"width": 640, "height": 480, "intrinsic_matrix": K.T.ravel().tolist()}))
    elif kind == "yaml-ros":
        path.write_text(f"camera_matrix:\n  rows: 3\n  cols: 3\n  data: {K.ravel().tolist()}\n")
    elif kind == "npz":
        np.savez(path, intrinsics=K)
    elif kind == "mat":
        scipy.io.savemat(path, {"intrinsic_matrix": K, "factor_depth": 1000.0})
    return path


@pytest.mark.parametrize("kind", ["json", "json-matrix", "json-focal", "json-open3d", "yaml-ros", "npz", "mat"])
def test_the_camera_matrix_is_read_from_every_kind_of_file(tmp_path, kind):
    np.testing.assert_array_equal(read_intrinsics([str(write_calibration(tmp_path, kind))]), K)


def test_the_camera_matrix_is_read_from_four_numbers():
    np.testing.assert_array_equal(read_intrinsics(NUMBERS), K)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (("600", "610", "320"), "takes fx fy cx cy or one file, got 3 values"),
        (("600", "610", "320", "wide"), "takes fx fy cx cy"),
        (("0", "610", "320", "240"), "fx = 0"),
        (("nan", "610", "320", "240"), "finite"),
        (("nowhere.json",), "no such calibration file: nowhere.json"),
    ],
)
def test_wrong_intrinsics_are_named(source, message):
    with pytest.raises(InputError, match=message):
        read_intrinsics(source)


@pytest.mark.parametrize("text", ["{", '{"width": 640}', '{"K": "wide"}', "7"])
def test_a_file_without_camera_matrix_is_named(tmp_path, text):
    path = tmp_path / "camera.json"
    path.write_text(text)
    with pytest.raises((DataError, InputError), match=r"camera\.json|\(3, 3\)"):
        read_intrinsics([str(path)])


def test_depth_in_millimetres_becomes_metres(millimetres):
    capture = read_capture(millimetres, NUMBERS, depth_scale=1000.0)
    assert isinstance(capture, DepthCapture)
    np.testing.assert_allclose(capture.depth, 0.515)
    assert capture.camera_pose is None


def test_depth_without_camera_matrix_is_an_error(millimetres):
    with pytest.raises(InputError, match="--intrinsics"):
        read_capture(millimetres)


def test_a_viewpoint_does_not_belong_to_a_depth_image(millimetres):
    with pytest.raises(InputError, match="--camera-pose"):
        read_capture(millimetres, NUMBERS, viewpoint=(0.0, 0.0, 1.0))


def test_a_colour_image_is_no_depth_image(tmp_path):
    Image.new("RGB", (64, 48)).save(tmp_path / "color.png")
    with pytest.raises(InputError, match=r"h, w\).*\(48, 64, 3\)"):
        read_capture(tmp_path / "color.png", NUMBERS)


def test_an_npz_brings_depth_camera_matrix_and_pose(tmp_path):
    np.savez(tmp_path / "view.npz", depth=np.full((48, 64), 0.5, np.float32), K=K, camera_pose=POSE)
    capture = read_capture(tmp_path / "view.npz")
    assert isinstance(capture, DepthCapture)
    np.testing.assert_array_equal(capture.intrinsics, K)
    np.testing.assert_array_equal(capture.camera_pose, POSE)


def test_an_npz_without_known_keys_lists_what_it_has(tmp_path):
    np.savez(tmp_path / "view.npz", colour=np.zeros(3))
    with pytest.raises(InputError, match=r"neither 'depth' nor .* it has \['colour'\]"):
        read_capture(tmp_path / "view.npz")


@pytest.mark.parametrize("name", ["a.ply", "a.npy", "a.npz", "a.xyz", "a.csv"])
def test_a_cloud_is_read_from_every_kind_of_file(tmp_path, name):
    points = np.random.default_rng(0).normal(size=(120, 3))
    path = tmp_path / name
    if name == "a.ply":
        trimesh.PointCloud(points).export(path)
    elif name == "a.npy":
        np.save(path, np.hstack([points, np.ones((120, 3))]))
    elif name == "a.npz":
        np.savez(path, points=points, viewpoint=[0.0, 0.0, 1.0])
    else:
        np.savetxt(path, points, delimiter="," if name == "a.csv" else " ")
    cloud = read_capture(path, viewpoint=None if name == "a.npz" else (0.0, 0.0, 1.0))
    assert isinstance(cloud, PointCloud)
    np.testing.assert_allclose(cloud.points, points, atol=1e-6)
    np.testing.assert_array_equal(cloud.viewpoint, (0.0, 0.0, 1.0))


def test_camera_options_do_not_belong_to_a_cloud(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((120, 3)))
    with pytest.raises(InputError, match="is a cloud"):
        read_capture(tmp_path / "a.npy", NUMBERS)


@pytest.mark.parametrize(
    "name", ["broken.png", "broken.npz", "broken.npy", "broken.ply", "broken.xyz"], ids=lambda name: name[7:]
)
def test_a_broken_file_is_named(tmp_path, name):
    (tmp_path / name).write_bytes(b"\x89PNG no, not really\n")
    with pytest.raises(DataError, match=f"cannot read .*{name}"):
        read_capture(tmp_path / name, NUMBERS if name == "broken.png" else ())


def test_a_file_that_is_damaged_inside_is_named(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", depth=np.random.default_rng(0).random((90, 90)), K=np.eye(3))
    content = bytearray((tmp_path / "a.npz").read_bytes())
    begin = 30 + int.from_bytes(content[26:28], "little") + int.from_bytes(content[28:30], "little")
    content[begin] = 0xFF  # no kind of deflated block
    (tmp_path / "a.npz").write_bytes(bytes(content))
    with pytest.raises(zlib.error):
        np.load(tmp_path / "a.npz")["depth"]
    with pytest.raises(DataError, match=r"cannot read .*a\.npz"):
        read_capture(tmp_path / "a.npz")


def test_an_empty_calibration_is_named(tmp_path):
    (tmp_path / "camera.mat").write_bytes(b"")
    with pytest.raises(DataError, match=r"cannot read .*camera\.mat"):
        read_intrinsics([str(tmp_path / "camera.mat")])


def test_a_ply_without_points_is_named(tmp_path):
    header = ("ply", "format ascii 1.0", "element face 0", "property list uchar int vertex_indices", "end_header", "")
    (tmp_path / "a.ply").write_text("\n".join(header))
    with pytest.raises(DataError, match=r"cannot read .*a\.ply"):
        read_capture(tmp_path / "a.ply")


def test_a_calibration_with_aliases_is_refused_before_they_multiply(tmp_path):
    lines = ["a0: &a0 [1, 1]"] + [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 40)]
    (tmp_path / "bomb.yaml").write_text("\n".join([*lines, "K: *a39"]))
    with pytest.raises(DataError, match="aliases") as error:
        read_intrinsics([str(tmp_path / "bomb.yaml")])
    assert len(str(error.value)) < 1000


def test_a_pose_of_seven_numbers_is_position_and_quaternion(tmp_path):
    numbers = ["0.1", "0.2", "0.8", "0", "1", "0", "0"]
    pose = read_camera_pose(numbers)
    np.testing.assert_allclose(pose, [[1, 0, 0, 0.1], [0, -1, 0, 0.2], [0, 0, -1, 0.8], [0, 0, 0, 1]], atol=1e-12)
    with pytest.raises(InputError, match="length 1, got length 2"):
        read_camera_pose(["0", "0", "0", "2", "0", "0", "0"])
    with pytest.raises(InputError, match="looks like millimetres"):
        read_camera_pose(["100", "200", "800", "0", "1", "0", "0"])


def test_a_file_holds_a_pose_in_any_form_and_under_any_of_its_names(tmp_path):
    half = 0.5**0.5
    numbers = [0.1, 0.2, 0.8, half, half, 0.0, 0.0]
    pose = read_camera_pose(list(map(str, numbers)))
    ros = {"x": half, "y": 0.0, "z": 0.0, "w": half}
    position = {"x": 0.1, "y": 0.2, "z": 0.8}
    files = {
        "a.json": {"T_base_camera": numbers},
        "b.json": numbers,
        "c.json": {"camera_pose": pose.ravel().tolist()},
        "d.yaml": {"header": {"frame_id": "base"}, "pose": {"position": position, "orientation": ros}},
        "e.yaml": {"transform": {"translation": position, "rotation": ros}},
        "f.json": {"position": position, "orientation": ros},
    }
    for name, content in files.items():
        (tmp_path / name).write_text(json.dumps(content))  # JSON is YAML, too
    (tmp_path / "row.txt").write_text(" ".join(map(str, numbers)))
    (tmp_path / "column.txt").write_text("\n".join(map(str, numbers)))
    np.save(tmp_path / "seven.npy", numbers)
    for name in (*files, "row.txt", "column.txt", "seven.npy"):
        np.testing.assert_allclose(read_camera_pose([str(tmp_path / name)]), pose, atol=1e-12, err_msg=name)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"pose": {"position": [0, 0, 1], "orientation": {}}}, "position with x, y, z .* and orientation with x, y, z"),
        ({"pose": {"eye": [0, 0, 1]}}, "must be a 4 x 4 matrix, its 16 numbers .* 7 numbers x y z .* got {'eye'"),
        ({"pose": [1.0, 2.0, 3.0]}, "must be a 4 x 4 matrix, .*, got .1.0, 2.0, 3.0"),
        ({"pose": "here"}, "must be a 4 x 4 matrix, .*, got 'here'"),
        ({"position": {"x": 0, "y": 0, "z": 1}}, "must be a 4 x 4 matrix, .* position and orientation by name"),
    ],
)
def test_a_pose_in_no_known_form_is_one_line(tmp_path, content, message):
    (tmp_path / "pose.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=message) as error:
        read_camera_pose([str(tmp_path / "pose.json")])
    assert "\n" not in str(error.value)


def test_an_npz_may_call_the_pose_by_any_of_its_names(tmp_path):
    np.savez(tmp_path / "view.npz", depth=np.full((48, 64), 0.5, np.float32), K=K, T_world_camera=POSE)
    capture = read_capture(tmp_path / "view.npz")
    assert isinstance(capture, DepthCapture)
    np.testing.assert_array_equal(capture.camera_pose, POSE)


def test_arrays_of_text_are_no_capture(tmp_path):
    np.savez(tmp_path / "a.npz", depth=np.full((20, 20), "far"), K=np.eye(3))
    with pytest.raises(InputError, match=r"depth in .*a\.npz must be real numbers"):
        read_capture(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", points=np.full((20, 3), "far"))
    with pytest.raises(InputError, match=r"points in .*b\.npz must be real numbers"):
        read_capture(tmp_path / "b.npz")


def test_pickles_are_not_opened(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{"surprise": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(DataError, match="cannot read"):
        read_capture(tmp_path / "a.npy")


@pytest.mark.parametrize("name", ["scan.pcd", "depth"])
def test_an_unknown_kind_of_file_lists_the_known_ones(tmp_path, name):
    (tmp_path / name).write_text("")
    with pytest.raises(InputError, match=r"known are \.png.*\.ply"):
        read_capture(tmp_path / name)


def test_a_camera_pose_is_read_from_numbers_and_files(tmp_path):
    np.save(tmp_path / "pose.npy", POSE)
    np.savetxt(tmp_path / "pose.txt", POSE)
    (tmp_path / "pose.json").write_text(json.dumps({"camera_pose": POSE.tolist()}))
    (tmp_path / "bare.json").write_text(json.dumps(POSE.tolist()))
    np.testing.assert_allclose(read_camera_pose([repr(float(x)) for x in POSE.ravel()]), POSE)
    for name in ("pose.npy", "pose.txt", "pose.json", "bare.json"):
        np.testing.assert_allclose(read_camera_pose([str(tmp_path / name)]), POSE)


def test_a_wrong_camera_pose_is_named(tmp_path):
    np.save(tmp_path / "pose.npy", POSE[:3])
    with pytest.raises(InputError, match=r"pose\.npy.*\(3, 4\)"):
        read_camera_pose([str(tmp_path / "pose.npy")])
    with pytest.raises(InputError, match="16 numbers"):
        read_camera_pose(["1", "0"])
    (tmp_path / "pose.json").write_text("{}")
    with pytest.raises(DataError, match="no camera pose"):
        read_camera_pose([str(tmp_path / "pose.json")])


def test_a_mask_says_where_it_is_not_black(tmp_path):
    Image.fromarray(np.eye(4, dtype=np.uint8) * 7).save(tmp_path / "mask.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.png"), np.eye(4, dtype=bool))


def test_a_ply_that_holds_fewer_points_than_it_announces_is_cut_short(tmp_path):
    header = ("ply", "format ascii 1.0", "element vertex 1000000", *(f"property float {axis}" for axis in "xyz"))
    rows = [f"{n} 0 0" for n in range(300)]
    (tmp_path / "a.ply").write_text("\n".join([*header, "end_header", *rows, ""]))
    with pytest.raises(DataError, match="announces 1000000 vertices and holds 300"):
        read_capture(tmp_path / "a.ply")


def test_an_archive_that_is_called_npy_is_named(tmp_path):
    np.savez(tmp_path / "a.npz", points=np.zeros((200, 3)))
    (tmp_path / "a.npz").rename(tmp_path / "a.npy")
    with pytest.raises(DataError, match=r"call it \.npz"):
        read_capture(tmp_path / "a.npy")


def test_a_name_that_no_file_can_have_is_no_file():
    with pytest.raises(InputError, match="no such calibration file: xxx") as error:
        read_intrinsics(["x" * 5000])
    assert len(str(error.value)) < 500

"""Frames as users keep them: what is read, and what is said when something is wrong."""

import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from icgnet.benchmark.labelled_frames import find_frames, read_frame
from icgnet.errors import DataError, InputError
from labelled_scenes import DEPTH, LABELS, POSE, pixels_on, write_frame
from tabletop_scenes import INTRINSICS


def read(folder):
    return {path.name: read_frame(path) for path in find_frames(folder)}


@pytest.fixture
def folder(tmp_path):
    write_frame(tmp_path, "seen", labelled=True)
    return tmp_path


@pytest.fixture
def clicked(tmp_path):
    write_frame(tmp_path, "touched", labelled=False)
    return tmp_path


def test_a_frame_with_labels_is_read(folder):
    frame = read(folder)["seen"]
    measured = DEPTH > 0
    np.testing.assert_allclose(frame.depth[measured], DEPTH[measured], atol=6e-5)
    assert np.isnan(frame.depth[~measured]).all()
    np.testing.assert_array_equal(frame.intrinsics, INTRINSICS)
    np.testing.assert_array_equal(frame.labels, LABELS)
    assert (frame.camera_pose, frame.clicks, frame.colour) == (None, None, None)
    assert frame.subset == folder.name
    assert frame.camera is None


def test_the_name_of_the_camera_is_read_and_that_of_the_frame_goes_first(folder):
    write_frame(folder, "other", labelled=True)
    (folder / "camera.json").write_text(json.dumps({"camera": "d435"}))
    described = json.loads((folder / "seen.json").read_text())
    (folder / "seen.json").write_text(json.dumps({**described, "camera": "kinect_v1"}))
    assert {name: frame.camera for name, frame in read(folder).items()} == {"seen": "kinect_v1", "other": "d435"}


def test_an_npz_with_clicks_is_read(clicked):
    frame = read(clicked)["touched"]
    np.testing.assert_allclose(frame.camera_pose, POSE)
    assert read_frame(find_frames(clicked)[0], pose=False).camera_pose is None
    assert frame.labels is None
    assert [len(item.clicks) for item in frame.clicks.objects] == [5, 5, 5]
    assert frame.clicks.objects[0].class_name == "box"
    assert not frame.clicks.uncertain
    np.testing.assert_array_equal(frame.clicks.support, pixels_on(0, 12))


def test_one_camera_serves_all_frames_of_a_folder_and_folders_are_subsets(tmp_path):
    for name in ("one", "two"):
        write_frame(tmp_path / "near", name, labelled=True)
    (tmp_path / "near" / "one.json").rename(tmp_path / "near" / "camera.json")
    (tmp_path / "near" / "two.json").write_text(json.dumps({"subset": "others", "T_world_camera": POSE.tolist()}))
    frames = read(tmp_path)
    assert {name: frame.subset for name, frame in frames.items()} == {"near/one": "near", "near/two": "others"}
    np.testing.assert_array_equal(frames["near/two"].intrinsics, INTRINSICS)
    np.testing.assert_allclose(frames["near/two"].camera_pose, POSE)


def test_the_subset_of_a_linked_frame_is_the_folder_of_the_link(folder, tmp_path_factory):
    links = tmp_path_factory.mktemp("linked")
    for path in folder.iterdir():
        (links / path.name).symlink_to(path)
    assert read(links)["seen"].subset == links.name


def test_patterns_put_frames_into_subsets(folder):
    write_frame(folder, "other", labelled=True)
    (folder / "subsets.json").write_text('{"first": ["se*", "x"]}')
    assert {name: frame.subset for name, frame in read(folder).items()} == {"seen": "first", "other": folder.name}
    (folder / "subsets.json").write_text('{"first": "se*"}')
    with pytest.raises(DataError, match=r"subsets.json: 'first' must be a list of patterns"):
        read(folder)


def test_labels_of_16_bits_with_gaps_and_a_larger_colour_image_are_read(folder):
    Image.fromarray((300 * LABELS).astype(np.uint16)).save(folder / "seen_labels.png")
    Image.new("RGB", (320, 240), "red").save(folder / "seen_color.jpg")
    frame = read(folder)["seen"]
    np.testing.assert_array_equal(frame.labels, LABELS)
    assert frame.colour.shape == (*DEPTH.shape, 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: (f / "seen_labels.png").unlink(), "needs seen_labels.png or seen_clicks.json, and has neither"),
        (lambda f: (f / "seen_clicks.json").write_text("{}"), "and has both"),
        (lambda f: Image.new("L", (5, 4), 1).save(f / "seen_labels.png"), r"seen_labels.png: .*120 x 160.*\(4, 5\)"),
        (lambda f: Image.new("RGB", (160, 120)).save(f / "seen_labels.png"), r"one channel of .*\(120, 160, 3\)"),
        (lambda f: Image.new("L", (160, 120)).save(f / "seen_labels.png"), "labels no object"),
        (lambda f: (f / "seen_labels.png").write_bytes(b"no"), "seen_labels.png: cannot be read"),
        (lambda f: (f / "seen_depth.png").write_bytes(b"no"), "seen_depth.png: cannot be read"),
        (lambda f: (f / "seen_color.jpg").write_bytes(b"no"), "seen_color.jpg: cannot be read"),
        (lambda f: Image.new("I;16", (160, 120)).save(f / "seen_depth.png"), "seen_depth.png: depth holds no measured"),
        (lambda f: (f / "seen.json").unlink(), "seen.json or camera.json must give depth_scale"),
        (lambda f: (f / "seen.json").write_text("{"), "seen.json: cannot be read"),
        (lambda f: (f / "seen.json").write_text("[1]"), "seen.json: must hold names with values"),
        (lambda f: (f / "seen.json").write_text('{"depth_scale": "mm"}'), "units per metre .* got 'mm'"),
        (lambda f: (f / "seen.json").write_text('{"depth_scale": 1000}'), "must give K"),
        (lambda f: (f / "seen.json").write_text('{"depth_scale": 1000, "K": [1, 2]}'), r"seen_depth.png: .*\(2,\)"),
        (lambda f: np.savez(f / "seen.npz", depth=DEPTH, K=INTRINSICS), "seen: there is _depth.png and .npz"),
    ],
)
def test_what_is_wrong_with_a_frame_is_said_in_one_line(folder, change, message):
    change(folder)
    with pytest.raises(DataError, match=message) as raised:
        read(folder)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("objects", "message"),
    [
        ([], r"objects must be a list of at least one object, got \[\]"),
        ([{"clicks": []}], "object 0 must have clicks"),
        ([{"clicks": [[3, 4]]}, {"clicks": [[160, 0]]}], r"object 1 .*\[0, 0\] to \[159, 119\], got \[160, 0\]"),
        ([{"clicks": [[0, -1]]}], r"got \[0, -1\]"),
        ([{"clicks": [[0]]}], r"got \[0\]"),
        ([{"clicks": {"u": 3}}], "object 0 must be pixels"),
        ([{"clicks": [[3, 4]], "class": 7}], "class of object 0 must be a text, got 7"),
        ([{"clicks": [[3, 4]], "graspable": "yes"}], "graspable of object 0 must be true or false, got 'yes'"),
    ],
)
def test_what_is_wrong_with_clicks_is_said_in_one_line(clicked, objects, message):
    (clicked / "touched_clicks.json").write_text(json.dumps({"objects": objects}))
    with pytest.raises(DataError, match=rf"touched_clicks.json: .*{message}"):
        read(clicked)


def test_clicks_need_only_objects(clicked):
    (clicked / "touched_clicks.json").write_text('{"objects": [{"clicks": [[3.4, 5]]}], "uncertain": true, "by": "me"}')
    marked = read(clicked)["touched"].clicks
    np.testing.assert_array_equal(marked.objects[0].clicks, [[3, 5]])
    assert (marked.objects[0].class_name, marked.objects[0].graspable, marked.uncertain) == (None, False, True)
    assert len(marked.support) == 0


def test_a_cloud_is_no_frame(clicked):
    np.savez(clicked / "touched.npz", points=np.zeros((5, 3)))
    with pytest.raises(DataError, match=r"touched\.npz: it is a cloud"):
        read(clicked)


def test_folders_without_frames_are_errors(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        find_frames(tmp_path / "nowhere")
    with pytest.raises(
        DataError, match=r"no frame here or in the folders inside: a frame is NAME_depth\.png or NAME\.npz"
    ):
        find_frames(tmp_path)


GUIDE = Path(__file__).parents[2] / "docs" / "guides" / "real_captures.md"


def run_script_of_guide(name: str, monkeypatch, *arguments: str) -> None:
    """The script that the guide says to save under a name."""
    (script,) = re.findall(rf"^<!-- file: {re.escape(name)} -->\n```python\n(.*?)^```", GUIDE.read_text(), re.S | re.M)
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    exec(compile(script, f"{name} of {GUIDE.name}", "exec"), {})


def test_the_guide_turns_polygons_into_labels(folder, monkeypatch):
    (folder / "seen_labels.png").unlink()
    outline = {"label": "mug", "points": [[10.2, 20.0], [40, 20], [40, 50], [10, 50]]}
    other = {"label": "box", "points": [[100, 80], [120, 80], [120, 100]]}
    drawn = {"imageWidth": 160, "imageHeight": 120, "shapes": [outline, other]}
    (folder / "seen_color.json").write_text(json.dumps(drawn))
    run_script_of_guide("labels.py", monkeypatch, str(folder / "seen_color.json"))
    labels = read(folder)["seen"].labels
    assert (labels[30, 20], labels[85, 115], labels[0, 0]) == (2, 1, 0)


def test_the_guide_asks_for_clicks(folder, monkeypatch):
    (folder / "seen_labels.png").unlink()
    clicks = iter([[(20.4, 30.6), (21, 31)], [(50, 60)], [], [(1, 2)], []])
    answers = iter(["mug", "y", "box", "n"])
    figure = SimpleNamespace(clf=lambda: None, imshow=lambda *_, **__: None, title=lambda _: None)
    figure.ginput = lambda **_: next(clicks)
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", figure)
    monkeypatch.setattr("matplotlib.pyplot", figure, raising=False)
    monkeypatch.setattr("builtins.input", lambda _: next(answers))
    run_script_of_guide("click.py", monkeypatch, str(folder / "seen_depth.png"))
    marked = read(folder)["seen"].clicks
    assert [(item.class_name, item.graspable) for item in marked.objects] == [("mug", True), ("box", False)]
    np.testing.assert_array_equal(marked.objects[0].clicks, [[20, 31], [21, 31]])
    assert marked.support.tolist() == [[1, 2]]


def test_the_clicks_of_the_guide_are_clicks(clicked):
    example = re.findall(r"^```json\n(.*?)^```", GUIDE.read_text(), re.S | re.M)[0]
    (clicked / "touched_clicks.json").write_text(example)
    np.savez(clicked / "touched.npz", depth=np.ones((480, 640)), K=INTRINSICS)
    assert [item.class_name for item in read(clicked)["touched"].clicks.objects] == ["mug", "box"]

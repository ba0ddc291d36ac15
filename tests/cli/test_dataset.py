"""`icgnet dataset inspect` on a small data set of cubes, written by hand."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from icgnet.cli.main import main
from icgnet.datagen.recipe import FORMAT_VERSION, Recipe, RecipeContacts, RecipeObject, pack_bits, write_shard
from icgnet.objects.object_set import load_object_set
from shape_scenes import HEADER

EDGE = 0.04
SCENES = 3


@pytest.fixture(autouse=True)
def plain_output(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("ICGNET_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.fixture
def objects(tmp_path: Path) -> Path:
    folder = tmp_path / "things"
    folder.mkdir()
    trimesh.creation.box([EDGE] * 3).export(folder / "cube.stl")
    trimesh.creation.box([EDGE, EDGE, 2 * EDGE]).export(folder / "brick.stl")
    (folder / "objects.yaml").write_text("units: m\nclasses: {cube: box}\nsplits: {test: []}\n")
    return folder


@pytest.fixture
def data(tmp_path: Path, objects: Path) -> Path:
    folder = tmp_path / "data"
    folder.mkdir()
    write_shard(folder / "scenes-0000000.parquet", [cube_scene(number) for number in range(SCENES)], HEADER)
    object_set = load_object_set(objects)
    manifest = {
        **HEADER.to_dict(),
        "object_set": "things",
        "split": "train",
        "seed": 5,
        "objects": {key: object_set.fingerprint(key) for key in ("brick", "cube")},
    }
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


def cube_scene(number: int) -> Recipe:
    centre = np.array([0.15, 0.15, 0.05 + EDGE / 2], np.float32)
    success = np.zeros((2, 12), bool)
    success[0, 4:8] = True
    contacts = RecipeContacts(
        positions=centre + np.array([[0, EDGE / 2, 0], [EDGE / 2, 0, 0]], np.float32),
        normals=np.array([[0, 1, 0], [1, 0, 0]], np.float32),
        objects=np.zeros(2, int),
        widths=np.full(2, EDGE, np.float32),
        success=pack_bits(success),
        collided=pack_bits(~success),
        disturbed=pack_bits(np.zeros((2, 12), bool)),
    )
    cube = RecipeObject("cube", "box", 1.0, centre, np.array([1, 0, 0, 0], np.float32))
    return Recipe(number, "packed", "things", "train", 5, HEADER.gripper, (cube,), contacts)


def inspect(*arguments: object) -> int:
    return main(["dataset", "inspect", "--panel", "76", "88", "--data", *map(str, arguments)])


def test_the_card_is_printed_and_written_with_sheets(data, objects, tmp_path, capsys):
    out = tmp_path / "card"
    assert inspect(data, "--objects", objects, "--out", out, "--scenes", 1) == 0
    printed = capsys.readouterr().out
    card = json.loads((out / "card.json").read_text())
    assert card["statistics"]["scenes"] == SCENES
    assert card["statistics"]["all"]["positive"] == pytest.approx(4 / 24)
    assert card["statistics"]["names"]["never"] == ["brick"]
    assert card["checks"]["results"]["contact off its mesh"]["failed"] == 0.0
    assert card["checks"]["scenes"] == SCENES
    assert card["unchecked"] == ""
    document = (out / "card.md").read_text()
    for words in ("Approach angles", "-90.0", "16.7 %", "brick", "hand inside an object"):
        assert words in printed
        assert words in document
    assert sorted(path.name for path in out.iterdir()) == ["card.json", "card.md", "sheet_00.png"]


def test_without_the_objects_the_card_says_why_there_are_no_sheets(data, tmp_path, capsys):
    out = tmp_path / "card"
    assert inspect(data, "--out", out) == 0
    reason = "they need the object set 'things': give its folder with --objects"
    assert reason in capsys.readouterr().out
    assert reason in (out / "card.md").read_text()
    assert json.loads((out / "card.json").read_text())["checks"] is None
    assert not list(out.glob("*.png"))


def test_a_set_that_is_not_there_is_no_reason_to_keep_the_card_back(data, capsys):
    assert inspect(data, "--objects", "nowhere") == 0
    printed = capsys.readouterr().out
    assert "Approach angles" in printed
    assert "no object set 'nowhere'" in printed


def test_another_set_and_changed_objects_are_told(data, objects, capsys):
    assert inspect(data, "--objects", "procedural") == 0
    assert "made of the object set 'things', this one is 'procedural'" in capsys.readouterr().out
    trimesh.creation.box([2 * EDGE] * 3).export(objects / "cube.stl")
    assert inspect(data, "--objects", objects) == 0
    assert "objects that have changed since the scenes were made: 1, the first one is cube" in capsys.readouterr().out


def test_chosen_scenes_are_drawn_and_an_earlier_card_is_replaced(data, objects, tmp_path):
    out = tmp_path / "card"
    for ids in (["--ids", "0"], ["--ids", "0", "2"]):
        assert inspect(data, "--objects", objects, "--out", out, *ids, "--checked", 1) == 0
    assert json.loads((out / "card.json").read_text())["checks"]["scenes"] == 1


def test_wrong_use_is_one_line_that_names_it(data, objects, tmp_path, capsys):
    no_manifest, foreign = tmp_path / "no_manifest", tmp_path / "foreign"
    for folder in (no_manifest, foreign):
        folder.mkdir()
    (foreign / "holiday.jpg").write_text("")
    for arguments, words in (
        (["nowhere"], "no such folder: nowhere"),
        ([no_manifest], "no manifest.json"),
        ([data, "--objects", objects, "--ids", "7"], "there is no scene 7; the scenes are 0 to 2"),
        ([data, "--checked", "0"], "checked at least 1, got 12 and 0"),
        ([data, "--panel", "76", "9000"], "between 16 and 4000 pixels high and wide, got 76 x 9000"),
        ([data, "--out", foreign], "holds other files"),
    ):
        assert inspect(*arguments) == 2
        error = capsys.readouterr().err
        assert error.startswith("error: ")
        assert error.count("\n") == 1
        assert words in error


def test_broken_files_and_other_versions_are_named(data, capsys):
    manifest = data / "manifest.json"
    content = manifest.read_text()
    manifest.write_text(content.replace(f'"format_version": {FORMAT_VERSION}', '"format_version": 99'))
    assert inspect(data) == 2
    assert "format version 99" in capsys.readouterr().err
    manifest.write_text(content[:50])
    assert inspect(data) == 2
    assert "broken manifest" in capsys.readouterr().err
    manifest.write_text(content)
    shard = data / "scenes-0000000.parquet"
    shard.write_bytes(shard.read_bytes()[:300])
    assert inspect(data) == 2
    assert "scenes-0000000.parquet" in capsys.readouterr().err
    shard.unlink()
    assert inspect(data) == 2
    assert "no recipes" in capsys.readouterr().err

"""What generation does with a folder in which some objects are broken, and with one that has changed since."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from icgnet.cli.main import main
from icgnet.datagen import usable_objects
from icgnet.datagen.config import GenerateConfig, LabelSettings
from icgnet.datagen.generate import generate
from icgnet.datagen.recipe import read_recipes
from icgnet.datagen.usable_objects import NAMED
from icgnet.errors import DataError, InputError
from icgnet.objects.base import UnusableObjectError
from icgnet.objects.object_set import load_object_set
from icgnet.objects.urdf_set import UrdfObjectSet
from icgnet.simulation import world
from icgnet.simulation.config import WideScenes

GEOMETRY = "<visual><geometry>{0}</geometry></visual><collision><geometry>{0}</geometry></collision>"
GOOD = ("brick", "post", "tile")


def write_urdf(folder: Path, name: str, shape: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.urdf").write_text(
        f'<robot name="{name}"><link name="base">{GEOMETRY.format(shape)}</link></robot>'
    )


def box(*size: float) -> str:
    return f'<box size="{" ".join(map(str, size))}"/>'


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("ICGNET_CACHE", str(tmp_path_factory.mktemp("cache")))


@pytest.fixture
def objects(tmp_path) -> Path:
    """Three good objects for piles."""
    folder = tmp_path / "good" / "things"
    for name, size in zip(GOOD, ((0.05, 0.06, 0.1), (0.03, 0.03, 0.12), (0.06, 0.06, 0.03)), strict=True):
        write_urdf(folder / "pile" / "train", name, box(*size))
    return folder


@pytest.fixture
def broken(tmp_path, objects) -> Path:
    """The same three among others that cannot be used, one that is open and one that crosses itself."""
    folder = tmp_path / "mixed" / "things"
    train = folder / "pile" / "train"
    train.mkdir(parents=True)
    for path in (objects / "pile" / "train").iterdir():
        (train / path.name).write_bytes(path.read_bytes())
    (train / "cut.urdf").write_text("<robot")
    write_urdf(train, "lost", '<mesh filename="nowhere.obj"/>')
    (train / "empty.obj").write_text("v 0 0 0\n")
    write_urdf(train, "empty", '<mesh filename="empty.obj"/>')
    write_urdf(train, "millimetres", box(50, 60, 100))
    write_urdf(train, "twice", box(0.05, 0.05, 0.05))
    write_urdf(folder / "pile" / "test", "twice", box(0.05, 0.05, 0.06))
    return folder


def config_for(folder: Path, **changes) -> GenerateConfig:
    labels = LabelSettings(contacts=2, object_count=1)
    return replace(GenerateConfig(str(folder), "pile", scenes=3, seed=1, labels=labels), **changes)


def add_odd_objects(train: Path) -> None:
    cube = trimesh.creation.box([0.05, 0.05, 0.05])
    trimesh.Trimesh(cube.vertices, cube.faces[2:], process=False).export(train / "open.obj")
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.03)
    vertices = np.array(ball.vertices)
    vertices[0] *= -1.5
    trimesh.Trimesh(vertices, ball.faces, process=False).export(train / "crossed.obj")
    for name in ("open", "crossed"):
        write_urdf(train, name, f'<mesh filename="{name}.obj"/>')


def test_broken_objects_are_left_out_by_name_and_the_others_give_the_same_scenes(objects, broken, tmp_path):
    notices: list[str] = []
    generate(tmp_path / "a", config_for(broken), on_notice=notices.append)
    left_out = json.loads((tmp_path / "a" / "manifest.json").read_text())["left_out"]
    reasons = {
        "pile/cut": "broken URDF",
        "pile/empty": "the mesh is empty",
        "pile/lost": "missing mesh",
        "pile/millimetres": "the longest side is 100 m: are the units right?",
        "pile/twice": "2 objects have this name",
    }
    assert list(left_out) == list(reasons)
    for name, reason in reasons.items():
        assert reason in left_out[name]
        assert any(notice.startswith(f"{name} is left out: ") and reason in notice for notice in notices)
    generate(tmp_path / "b", config_for(objects))
    for with_broken, without in zip(read_recipes(tmp_path / "a"), read_recipes(tmp_path / "b"), strict=True):
        assert [placed.name for placed in with_broken.objects] == [placed.name for placed in without.objects]
        np.testing.assert_array_equal(with_broken.contacts.success, without.contacts.success)


def test_odd_objects_are_used_and_told(objects, tmp_path):
    add_odd_objects(objects / "pile" / "train")
    notices: list[str] = []
    generate(tmp_path / "out", config_for(objects), on_notice=notices.append)
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert "open" in manifest["doubtful"]["pile/open"]
    assert "intersects itself" in manifest["doubtful"]["pile/crossed"]
    assert manifest["objects"].keys() >= {"pile/open", "pile/crossed"}
    (notice,) = notices
    assert "pile/crossed, pile/open" in notice


def test_with_nothing_left_there_is_an_error_that_says_so(broken, tmp_path):
    for name in GOOD:
        (broken / "pile" / "train" / f"{name}.urdf").unlink()
    with pytest.raises(InputError, match=r"no usable objects for pile scenes, split 'train' \(5 left out: .*pile/cut"):
        generate(tmp_path / "out", config_for(broken))
    assert not (tmp_path / "out").exists()


def test_a_second_start_does_not_read_the_meshes_again(objects, tmp_path, monkeypatch):
    generate(tmp_path / "out", config_for(objects))
    monkeypatch.setattr("icgnet.objects.check._report", None)
    assert generate(tmp_path / "out", config_for(objects)).scenes_found == 3


def test_changed_new_and_lost_objects_are_named_when_a_folder_is_continued(objects, tmp_path):
    generate(tmp_path / "out", config_for(objects, scenes=1))
    train = objects / "pile" / "train"
    write_urdf(train, "brick", box(0.05, 0.06, 0.11))
    (train / "post.urdf").rename(train / "pole.urdf")
    with pytest.raises(DataError, match=r"objects differ: pile/brick is changed, pile/pole is new, pile/post is gone$"):
        generate(tmp_path / "out", config_for(objects))


def test_many_changes_are_not_all_named(objects, tmp_path):
    generate(tmp_path / "out", config_for(objects, scenes=1))
    for number in range(NAMED + 3):
        write_urdf(objects / "pile" / "train", f"new_{number}", box(0.05, 0.05, 0.05))
    with pytest.raises(DataError, match=f"pile/new_{NAMED - 1} is new and 3 more$"):
        generate(tmp_path / "out", config_for(objects))


def test_a_folder_that_says_nothing_of_its_objects_is_read_but_not_continued(objects, tmp_path):
    generate(tmp_path / "out", config_for(objects, scenes=1))
    path = tmp_path / "out" / "manifest.json"
    manifest = json.loads(path.read_text())
    del manifest["objects"]
    path.write_text(json.dumps(manifest))
    assert len(read_recipes(tmp_path / "out")) == 1
    with pytest.raises(DataError, match="objects are not recorded there"):
        generate(tmp_path / "out", config_for(objects))


def test_the_command_line_warns_of_each_object_that_is_left_out(broken, tmp_path, capsys):
    options = ["--objects", str(broken), "--scene", "pile", "--scenes", "1", "--labels.contacts", "1"]
    assert main(["generate", "--out", str(tmp_path / "out"), *options]) == 0
    error = capsys.readouterr().err
    assert error.count("is left out") == 5
    assert "warning: pile/lost is left out: " in error


def test_an_object_that_cannot_be_simulated_is_named_and_left_out_while_the_rest_goes_on(
    objects, tmp_path, monkeypatch, caplog
):
    add_objects = world.add_objects

    def with_a_flat_one(spec, bodies, physics, movable):
        add_objects(spec, bodies, physics, movable)
        for index, body in enumerate(bodies):
            if body.model.name == "pile/brick":
                mesh = spec.mesh(f"mesh_{index}_0")
                mesh.uservert = np.array(mesh.uservert).reshape(-1, 3).dot(np.diag([1.0, 1.0, 1e-12])).ravel()

    monkeypatch.setattr(world, "add_objects", with_a_flat_one)
    generate(tmp_path / "out", config_for(objects, scenes=6))
    names = {placed.name for recipe in read_recipes(tmp_path / "out") for placed in recipe.objects}
    assert names == {"pile/post", "pile/tile"}
    assert "object 'pile/brick' cannot be used: " in caplog.text


def test_what_breaks_only_in_a_scene_is_left_out_of_it_whoever_makes_the_scenes(broken, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(usable_objects, "check_object_set", lambda object_set, keys: [])
    for workers in (1, 2):
        generate(tmp_path / str(workers), config_for(broken, scenes=6, workers=workers))
    for alone, together in zip(read_recipes(tmp_path / "1"), read_recipes(tmp_path / "2"), strict=True):
        assert [each.name for each in alone.objects] == [each.name for each in together.objects]
        np.testing.assert_array_equal(alone.contacts.success, together.contacts.success)
        assert {each.name for each in alone.objects} <= {"pile/brick", "pile/post", "pile/tile"}
    assert "object 'pile/lost' cannot be used: " in caplog.text
    assert "; left out of scene " in caplog.text


def test_any_failure_of_a_mesh_library_names_the_object(objects, monkeypatch):
    def fails(self, key):
        raise RuntimeError("qhull precision error\n(see above)")

    monkeypatch.setattr(UrdfObjectSet, "_load", fails)
    with pytest.raises(
        UnusableObjectError, match=r"^object 'pile/brick' cannot be used: qhull precision error \(see a"
    ):
        load_object_set(str(objects)).model("pile/brick")


def test_what_is_too_large_for_every_table_is_told_once_and_the_rest_goes_on(tmp_path, capsys):
    folder = tmp_path / "meshes"
    folder.mkdir()
    for name, edges in {"brick": (0.05, 0.06, 0.08), "beam": (0.9, 0.2, 0.2), "long": (0.35, 0.05, 0.05)}.items():
        trimesh.creation.box(edges).export(folder / f"{name}.stl")
    (folder / "objects.yaml").write_text("units: m\nsplits: {val: [none]}\n")
    options = ["--objects", str(folder), "--scene", "table", "--scenes", "2", "--labels.contacts-per-object", "1"]
    options += ["--labels.wide.objects", "3", "3"]
    assert main(["generate", "--out", str(tmp_path / "out"), *options]) == 0
    error = capsys.readouterr().err
    assert error.count("never drawn") == 1
    assert "too large or too small for any table, so never drawn for one: beam (0.9 m)\n" in error
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["never_drawn"] == {"table": {"beam": "0.9 m"}}
    assert len(read_recipes(tmp_path / "out")) == 2


def test_a_bin_that_is_too_small_for_all_objects_is_drawn_anew(tmp_path):
    folder = tmp_path / "meshes"
    folder.mkdir()
    trimesh.creation.box((0.4, 0.05, 0.05)).export(folder / "plank.stl")
    (folder / "objects.yaml").write_text("units: m\nsplits: {val: [none]}\n")
    settings = LabelSettings(contacts_per_object=1, wide=WideScenes(objects=(1, 1)))
    config = GenerateConfig(objects=str(folder), scene="bin", scenes=4, labels=settings)
    generate(tmp_path / "out", config)
    recipes = read_recipes(tmp_path / "out")
    assert len(recipes) == 4
    for recipe in recipes:
        assert recipe.surroundings.extent is not None
        lower_x, lower_y, upper_x, upper_y = recipe.surroundings.extent
        assert min(upper_x - lower_x, upper_y - lower_y) > 0.4 * 0.7 * 0.85 / 0.8

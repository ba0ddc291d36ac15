import errno
import json
import os
from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from icgnet.datagen import recipe as recipe_module
from icgnet.datagen.config import GenerateConfig, LabelSettings, Variation, kind_of
from icgnet.datagen.generate import generate
from icgnet.datagen.label_scene import scene_rng
from icgnet.datagen.recipe import read_recipes, unpack_bits
from icgnet.errors import DataError, InputError

CONFIG = GenerateConfig(scenes=3, seed=5, shard_scenes=2, labels=LabelSettings(contacts=3, object_count=1))


BRICK = """<robot name="brick"><link name="base">
  <visual><geometry><box size="0.05 0.05 0.1"/></geometry></visual>
  <collision><geometry><box size="0.05 0.05 0.1"/></geometry></collision>
</link></robot>"""


def _files(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.parquet"))}


@pytest.fixture(scope="module")
def complete(tmp_path_factory):
    """The folder of an undisturbed run, in files of two scenes."""
    folder = tmp_path_factory.mktemp("complete")
    generate(folder, CONFIG)
    return folder


def test_a_run_writes_labelled_scenes(complete):
    recipes = read_recipes(complete)
    assert [recipe.scene_id for recipe in recipes] == [0, 1, 2]
    assert [recipe.kind for recipe in recipes] == ["packed", "pile", "pile"]
    for recipe in recipes:
        assert recipe.object_set == "procedural"
        assert len(recipe.contacts) == 3
        assert recipe.labels().shape == (3, 12)
        assert not (recipe.contacts.success & recipe.contacts.collided).any(), "a collided grasp is never a success"


def test_the_report_counts_what_is_in_the_files(complete):
    report = json.loads((complete / "report.json").read_text())
    recipes = read_recipes(complete)
    assert report["scenes"] == 3
    assert report["labels"] == 3 * 3 * 12
    assert report["positives"] == sum(int(recipe.labels().sum()) for recipe in recipes)
    assert report["objects"] == sum(len(recipe.objects) for recipe in recipes)
    assert report["labels_per_second_per_core"] == pytest.approx(report["labels"] / report["seconds"])
    collided = sum(int(unpack_bits(recipe.contacts.collided).sum()) for recipe in recipes)
    assert report["collided_share"] == pytest.approx(collided / report["labels"])
    assert report["bytes_per_scene"] == sum(map(len, _files(complete).values())) / 3
    assert {kind: counts["scenes"] for kind, counts in report["kinds"].items()} == {"packed": 1, "pile": 2}
    packed = report["kinds"]["packed"]
    assert packed["positives"] == recipes[0].labels().sum()
    assert packed["positive_share"] == packed["positives"] / (3 * 12)


def test_progress_begins_with_what_was_there(complete, tmp_path):
    generate(tmp_path, replace(CONFIG, scenes=1))
    heard = []
    generate(tmp_path, CONFIG, on_progress=heard.append)
    assert heard == [1, 2, 3]


def test_the_manifest_says_how_the_labels_were_made(complete):
    manifest = json.loads((complete / "manifest.json").read_text())
    assert manifest["format_version"] == 3
    assert manifest["seed"] == 5
    assert manifest["gripper"]["name"] == "franka"
    assert manifest["physics"]["timestep"] == 0.004
    assert len(manifest["angles_deg"]) == 12


@pytest.mark.slow
def test_two_workers_give_the_same_rows_as_one(complete, tmp_path):
    generate(tmp_path, replace(CONFIG, workers=2))
    assert _files(tmp_path) == _files(complete)


def test_deleted_shards_come_back_the_same(complete, tmp_path):
    for name in ("manifest.json", "scenes-0000000.parquet"):
        (tmp_path / name).write_bytes((complete / name).read_bytes())
    report = generate(tmp_path, CONFIG)
    assert (report.scenes, report.scenes_found) == (1, 2)
    assert _files(tmp_path) == _files(complete)


def test_a_killed_run_keeps_what_is_finished_and_goes_on(complete, tmp_path):
    def kill(done):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate(tmp_path, CONFIG, on_progress=kill)
    (tmp_path / "scenes-0000002.parquet.partial").write_bytes(b"half a file")
    assert list(_files(tmp_path)) == ["scenes-0000000.parquet"]
    generate(tmp_path, CONFIG)
    assert _files(tmp_path) == _files(complete)
    assert not list(tmp_path.glob("*.partial"))


def test_more_scenes_continue_a_smaller_run(complete, tmp_path):
    generate(tmp_path, replace(CONFIG, scenes=1))
    report = generate(tmp_path, CONFIG)
    assert (report.scenes, report.scenes_found) == (2, 1), "the scene of the unfinished file is not made again"
    assert _files(tmp_path) == _files(complete)


def test_fewer_scenes_leave_a_larger_folder_alone(complete):
    before = _files(complete)
    assert generate(complete, replace(CONFIG, scenes=1)).scenes == 0
    assert _files(complete) == before


def test_a_finished_run_does_nothing_again(complete):
    before = _files(complete)
    report = generate(complete, CONFIG)
    assert (report.scenes, report.scenes_found, report.labels) == (0, 3, 0)
    assert _files(complete) == before


@pytest.mark.parametrize(
    ("change", "difference"),
    [
        ({"seed": 6}, "seed is 5 there, 6 now"),
        ({"split": "val"}, "split is train there, val now"),
        ({"shard_scenes": 3}, "shard_scenes is 2 there, 3 now"),
        ({"labels": LabelSettings(contacts=4, object_count=1)}, "contacts is 3 there, 4 now"),
    ],
)
def test_a_folder_of_another_configuration_is_refused(complete, change, difference):
    with pytest.raises(DataError, match=f"another configuration.*{difference}"):
        generate(complete, replace(CONFIG, **change))


def test_a_truncated_shard_is_named(complete, tmp_path):
    for path in complete.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes()[: -50 if path.suffix == ".parquet" else None])
    with pytest.raises(DataError, match=r"scenes-0000000\.parquet"):
        generate(tmp_path, CONFIG)


def test_a_full_disk_is_one_error_and_leaves_no_half_file(complete, tmp_path, monkeypatch):
    write_table = recipe_module.pq.write_table

    def write_a_little(table, file, **options):
        file.write(b"PAR1")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as full:

        def fill_disk(done):
            if done == 2:
                full.setattr(recipe_module.pq, "write_table", write_a_little)

        with pytest.raises(DataError, match=r"scenes-0000002\.parquet: cannot write: No space left on device"):
            generate(tmp_path, CONFIG, on_progress=fill_disk)
    assert recipe_module.pq.write_table is write_table
    assert {path.name for path in tmp_path.iterdir()} == {".lock", "manifest.json", "scenes-0000000.parquet"}
    generate(tmp_path, CONFIG)
    assert _files(tmp_path) == _files(complete)


def test_two_runs_do_not_write_into_one_folder(tmp_path):
    def run_another(done):
        generate(tmp_path, replace(CONFIG, seed=6))

    with pytest.raises(DataError, match=f"process {os.getpid()} on .* is writing into this folder"):
        generate(tmp_path, CONFIG, on_progress=run_another)


def test_parquet_files_without_a_manifest_are_not_mixed_with_new_ones(complete, tmp_path):
    (tmp_path / "old.parquet").write_bytes(b"")
    with pytest.raises(DataError, match="give another folder"):
        generate(tmp_path, CONFIG)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("scene", "heap", "packed, pile, both, table, bin, wide, all, got 'heap'"),
        ("split", "training", "train, val, test, got 'training'"),
    ],
)
def test_an_unknown_kind_or_split_lists_the_valid_ones(field, value, message):
    # Set behind the back of the type checker that the tests run with.
    config = copy(CONFIG)
    object.__setattr__(config, field, value)
    with pytest.raises(InputError, match=message):
        config.__post_init__()


@pytest.mark.parametrize("change", [{"scenes": 0}, {"workers": 0}, {"seed": -1}, {"shard_scenes": 0}])
def test_numbers_out_of_range_are_refused(change):
    with pytest.raises(InputError, match=next(iter(change))):
        replace(CONFIG, **change)


@pytest.mark.parametrize("change", [{"contacts": 0}, {"object_count": 0}])
def test_label_settings_out_of_range_are_refused(change):
    with pytest.raises(InputError, match=next(iter(change))):
        LabelSettings(**change)


def test_variation_must_be_a_range():
    with pytest.raises(InputError, match="mass"):
        Variation(mass=(0.7, 0.3))


def test_unknown_objects_are_named(tmp_path):
    with pytest.raises(InputError, match="nowhere"):
        generate(tmp_path / "out", replace(CONFIG, objects="nowhere"))
    assert not (tmp_path / "out").exists()


def test_both_makes_one_packed_scene_for_two_piles():
    assert [kind_of("both", i) for i in range(6)] == ["packed", "pile", "pile", "packed", "pile", "pile"]
    assert kind_of("packed", 1) == "packed"


def test_there_must_be_objects_for_every_kind_of_scene(tmp_path):
    (tmp_path / "objects" / "pile" / "train").mkdir(parents=True)
    (tmp_path / "objects" / "pile" / "train" / "brick.urdf").write_text(BRICK)
    with pytest.raises(InputError, match="'objects' has no usable objects for packed scenes, split 'train'"):
        generate(tmp_path / "out", replace(CONFIG, objects=str(tmp_path / "objects")))
    assert not (tmp_path / "out").exists()


def test_every_scene_has_its_own_stream():
    draws = {scene_rng(seed, scene).integers(2**60) for seed in range(3) for scene in range(5)}
    assert len(draws) == 15
    children = np.random.SeedSequence(4).spawn(3)
    assert scene_rng(4, 2).integers(2**60) == np.random.default_rng(children[2]).integers(2**60)

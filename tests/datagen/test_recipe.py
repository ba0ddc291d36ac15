import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from icgnet.datagen.recipe import (
    FORMAT_VERSION,
    SCHEMA,
    Recipe,
    RecipeContacts,
    RecipeObject,
    pack_bits,
    read_label_header,
    read_recipes,
    unpack_bits,
    write_shard,
)
from icgnet.errors import DataError
from shape_scenes import HEADER


def _recipe(scene_id, contacts, rng):
    bits = [rng.integers(0, 2**12, contacts, dtype=np.uint16) for _ in range(3)]
    quaternion = rng.normal(size=4)
    return Recipe(
        scene_id,
        "pile",
        "procedural",
        "train",
        7,
        HEADER.gripper,
        tuple(
            RecipeObject(
                f"pile/box_{i:04d}",
                "box",
                0.875,
                rng.normal(size=3).astype(np.float32),
                (quaternion / np.linalg.norm(quaternion)).astype(np.float32),
            )
            for i in range(3)
        ),
        RecipeContacts(
            rng.normal(size=(contacts, 3)).astype(np.float32),
            rng.normal(size=(contacts, 3)).astype(np.float32),
            rng.integers(0, 3, contacts),
            rng.uniform(size=contacts).astype(np.float32),
            *bits,
        ),
    )


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "manifest.json").write_text(json.dumps(HEADER.to_dict()))
    rng = np.random.default_rng(0)
    first = [_recipe(0, 5, rng), _recipe(1, 0, rng), _recipe(2, 3, rng)]
    write_shard(tmp_path / "scenes-0000000.parquet", first, HEADER)
    write_shard(tmp_path / "scenes-0000003.parquet", [_recipe(3, 4, rng)], HEADER)
    return tmp_path


def test_recipes_survive_writing_and_reading(folder):
    rng = np.random.default_rng(0)
    written = [_recipe(0, 5, rng), _recipe(1, 0, rng), _recipe(2, 3, rng), _recipe(3, 4, rng)]
    for before, after in zip(written, read_recipes(folder), strict=True):
        for name in ("scene_id", "kind", "object_set", "split", "seed"):
            assert getattr(before, name) == getattr(after, name)
        for name, values in vars(before.contacts).items():
            np.testing.assert_array_equal(values, getattr(after.contacts, name))
        for placed, again in zip(before.objects, after.objects, strict=True):
            assert (placed.name, placed.class_name, placed.scale) == (again.name, again.class_name, again.scale)
            np.testing.assert_array_equal(placed.position, again.position)
            np.testing.assert_array_equal(placed.quaternion, again.quaternion)


def test_bits_survive_packing():
    flags = np.random.default_rng(1).random((50, 12)) < 0.3
    np.testing.assert_array_equal(unpack_bits(pack_bits(flags)), flags)


def test_bit_i_is_approach_angle_i(folder):
    recipe = read_recipes(folder)[0]
    for contact, bits in enumerate(recipe.contacts.success):
        for angle in range(12):
            assert recipe.labels()[contact, angle] == int(bits) // 2**angle % 2


def test_a_scene_has_the_poses_of_its_objects(folder):
    recipe = read_recipes(folder)[0]
    scene = recipe.scene()
    assert scene.kind == "pile"
    for placed, stored in zip(scene.objects, recipe.objects, strict=True):
        assert placed.name == stored.name
        np.testing.assert_allclose(placed.T_world_object[:3, 3], stored.position)
        np.testing.assert_allclose(np.linalg.det(placed.T_world_object[:3, :3]), 1.0)


def test_rows_can_be_read_without_this_package(folder):
    table = pq.read_table(folder / "scenes-0000000.parquet").to_pylist()
    assert len(table[0]["contacts"]) == 5
    assert set(table[0]["contacts"][0]) == {
        "position", "normal", "object", "width", "success", "collided", "disturbed",
    }  # fmt: skip


def test_a_truncated_file_is_named(folder):
    shard = folder / "scenes-0000003.parquet"
    shard.write_bytes(shard.read_bytes()[:-100])
    with pytest.raises(DataError, match=r"scenes-0000003\.parquet.*truncated"):
        read_recipes(folder)


def test_a_file_that_is_not_parquet_is_named(folder):
    (folder / "other.parquet").write_text("hello")
    with pytest.raises(DataError, match=r"other\.parquet"):
        read_recipes(folder)


def test_other_columns_are_named(folder):
    fields = [pa.field("seed", pa.string()) if field.name == "seed" else field for field in SCHEMA]
    pq.write_table(pa.Table.from_pylist([], pa.schema(fields)), folder / "scenes-0000003.parquet")
    with pytest.raises(DataError, match=r"scenes-0000003\.parquet.*seed is string"):
        read_recipes(folder)


def test_another_format_version_is_refused(folder):
    (folder / "manifest.json").write_text(json.dumps({"format_version": FORMAT_VERSION + 1}))
    with pytest.raises(DataError, match=f"format version {FORMAT_VERSION + 1}"):
        read_recipes(folder)


def test_data_of_the_first_version_are_refused_with_what_to_do(folder):
    (folder / "manifest.json").write_text(json.dumps({"format_version": 1}))
    with pytest.raises(
        DataError, match=r"format version 1, but .* reads 3: make the scenes again with icgnet generate"
    ):
        read_recipes(folder)


def test_folder_and_files_name_hand_and_classes(folder):
    assert read_label_header(folder) == HEADER
    written = json.loads(pq.read_schema(folder / "scenes-0000003.parquet").metadata[b"icgnet"])
    assert written == json.loads((folder / "manifest.json").read_text()) == HEADER.to_dict()


def test_a_file_of_another_hand_or_of_other_classes_is_named(folder):
    wider = replace(HEADER, gripper=replace(HEADER.gripper, name="wide", max_opening=0.14))
    more = replace(HEADER, classes=(*HEADER.classes, "vase"))
    for header, message in (
        (wider, r"hand 'wide' .*max_opening 0.14 instead of 0.08"),
        (more, "other, vase instead"),
    ):
        write_shard(folder / "scenes-0000003.parquet", [], header)
        with pytest.raises(DataError, match=rf"scenes-0000003\.parquet: its labels are not .*{message}"):
            read_recipes(folder)


def test_another_name_or_mounting_is_the_same_hand(folder):
    turned = replace(HEADER.gripper, name="mine", base_quaternion=(0.0, 0.0, 0.0, 1.0), base_offset=(0.0, 0.0, -0.2))
    write_shard(folder / "scenes-0000003.parquet", [], replace(HEADER, gripper=turned))
    assert len(read_recipes(folder)) == 3


@pytest.mark.parametrize("metadata", [None, {b"icgnet": b"{"}, {b"icgnet": b'{"format_version": 2}'}])
def test_a_file_that_does_not_name_its_hand_is_refused(folder, metadata):
    pq.write_table(pa.Table.from_pylist([], SCHEMA.with_metadata(metadata)), folder / "scenes-0000003.parquet")
    with pytest.raises(DataError, match=r"scenes-0000003\.parquet"):
        read_recipes(folder)


@pytest.mark.parametrize(
    "text", ["{", "[]", "{}", "[" * 3000, '{"format_version": 2, "gripper": 3, "classes": ["box"]}']
)
def test_a_broken_manifest_is_named(folder, text):
    (folder / "manifest.json").write_text(text)
    with pytest.raises(DataError, match=r"manifest\.json"):
        read_recipes(folder)


def test_a_folder_without_recipes_is_refused(tmp_path):
    with pytest.raises(DataError, match="not a recipe folder"):
        read_recipes(tmp_path)
    (tmp_path / "manifest.json").write_text(json.dumps(HEADER.to_dict()))
    with pytest.raises(DataError, match="no recipes"):
        read_recipes(tmp_path)

"""Scenes of a cube with one fault each: every check finds its own."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from icgnet.datagen.checks import LIMITS, check_scene, check_scenes, successful_grasps
from icgnet.datagen.recipe import Recipe, RecipeContacts, RecipeObject, pack_bits
from icgnet.errors import InputError
from icgnet.geometry.transforms import make_transform
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.gripper import load_gripper
from icgnet.objects.base import ObjectSet
from icgnet.objects.object_set import load_object_set
from icgnet.simulation.surroundings import Surroundings, block

EDGE = 0.04
GRIPPER = load_gripper("franka")
ON_TABLE = np.array([0.15, 0.15, TABLE_HEIGHT + EDGE / 2])
FROM_ABOVE = 6  # approach angle of 8 degrees off the vertical


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> ObjectSet:
    folder = tmp_path_factory.mktemp("things")
    trimesh.creation.box([EDGE] * 3).export(folder / "cube.stl")
    (folder / "objects.yaml").write_text("units: m\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ICGNET_CACHE", str(folder / "cache"))
        found = load_object_set(folder)
        found.signed_distance("cube")
    return found


def scene(*centres: np.ndarray) -> Recipe:
    """Cubes at these centres [m] and one contact on the +y side of the first, grasped from above."""
    placed = tuple(
        RecipeObject("cube", "box", 1.0, centre.astype(np.float32), np.array([1, 0, 0, 0], np.float32))
        for centre in centres
    )
    success = np.zeros((1, 12), bool)
    success[0, FROM_ABOVE] = True
    contacts = RecipeContacts(
        positions=(centres[0] + [0.0, EDGE / 2, 0.005])[None].astype(np.float32),
        normals=np.array([[0, 1, 0]], np.float32),
        objects=np.array([0]),
        widths=np.array([EDGE], np.float32),
        success=pack_bits(success),
        collided=pack_bits(~success),
        disturbed=pack_bits(np.zeros((1, 12), bool)),
    )
    return Recipe(7, "packed", "things", "train", 0, GRIPPER, placed, contacts)


def beside_wall(recipe: Recipe, centre: np.ndarray) -> Recipe:
    """The same with a block of 0.1 x 0.1 x 0.04 m, whose middle stands at a place [m]."""
    post = block("post", (0.1, 0.1, 0.04), make_transform(np.eye(3), centre))
    return replace(recipe, surroundings=Surroundings((0.0, 0.0, 0.3, 0.3), (post,)))


def with_contacts(recipe: Recipe, **changes) -> Recipe:
    return replace(recipe, contacts=replace(recipe.contacts, **changes))


def failed(recipe: Recipe, objects: ObjectSet) -> set[str]:
    measured = check_scene(recipe, objects).measured
    return {check for check, each in measured.items() if (each.amounts > LIMITS[check]).any()}


GOOD = scene(ON_TABLE)
FAULTY = {
    "contact off its mesh": with_contacts(
        GOOD, positions=GOOD.contacts.positions + np.array([0, 0.0015, 0]), widths=np.array([EDGE + 0.0015])
    ),
    "normal points inward": with_contacts(
        GOOD, normals=-GOOD.contacts.normals, widths=np.array([0.0]), success=pack_bits(np.zeros((1, 12), bool))
    ),
    "far side of the width off the mesh": with_contacts(GOOD, widths=np.array([EDGE - 0.002])),
    "object below the table": scene(ON_TABLE - [0.0, 0.0, 0.003]),
    "object floating": scene(ON_TABLE, ON_TABLE + [0.08, 0.0, 0.003]),
    "object outside the workspace": scene(ON_TABLE, ON_TABLE + [0.16, 0.0, 0.0]),
    "object inside another": scene(ON_TABLE, ON_TABLE + [EDGE - 0.003, 0.0, 0.0]),
    "hand inside an object": scene(ON_TABLE, ON_TABLE + [0.0, EDGE + 0.01, 0.0]),
    "hand inside the table": with_contacts(GOOD, success=pack_bits(np.eye(12, dtype=bool)[:1])),
    "object inside a structure": beside_wall(GOOD, ON_TABLE + [EDGE / 2 + 0.047, 0.0, 0.0]),
    "hand inside a structure": beside_wall(GOOD, ON_TABLE + [0.0, EDGE / 2 + 0.06, 0.0]),
}


def test_nothing_is_wrong_with_a_cube_on_the_table(objects):
    assert failed(GOOD, objects) == set()


@pytest.mark.parametrize("check", LIMITS)
def test_each_fault_is_found_by_its_check_alone(check, objects):
    assert failed(FAULTY[check], objects) == {check}


def test_stacked_and_leaning_objects_do_not_float(objects):
    on_top = ON_TABLE + [0.0, 0.01, EDGE + 0.001]
    third = on_top + [0.0, 0.01, EDGE + 0.001]
    assert "object floating" not in failed(scene(ON_TABLE, on_top, third), objects)
    measured = check_scene(scene(ON_TABLE, on_top, third + [0.0, 0.0, 0.004]), objects).measured
    np.testing.assert_allclose(measured["object floating"].amounts, [0.0, 0.001, 0.005], atol=2e-4)


def test_the_worst_case_is_named_with_its_scene(objects):
    deep = replace(FAULTY["object inside another"], scene_id=11)
    checks = check_scenes([GOOD, deep], objects)
    result = checks.results["object inside another"]
    assert result.number == 3
    assert result.failed == pytest.approx(2 / 3)
    assert result.worst == pytest.approx(0.003, abs=3e-4)
    assert (result.worst_scene, result.worst_name) == (11, "cube")
    assert checks.touching_pairs == 0.5
    assert checks.tops[50] == pytest.approx(EDGE, abs=1e-6)


def test_scenes_without_any_success_have_no_hands(objects):
    none = np.zeros(1, np.uint16)
    checks = check_scenes([with_contacts(GOOD, success=none)], objects)
    assert checks.results["hand inside an object"].number == 0
    assert checks.results["hand inside an object"].worst_scene is None


def test_an_object_that_the_set_lacks_is_an_error(objects):
    unknown = replace(GOOD, objects=(replace(GOOD.objects[0], name="sphere"),))
    with pytest.raises(InputError, match="no object 'sphere'"):
        check_scene(unknown, objects)


def test_grasps_amid_other_successes_are_the_safest():
    success = np.zeros((1, 12), bool)
    success[0, 3:8] = True
    grasps = successful_grasps(with_contacts(GOOD, success=pack_bits(success)))
    assert grasps.angles.tolist() == [3, 4, 5, 6, 7]
    np.testing.assert_allclose(grasps.scores, [0.6, 0.8, 1.0, 0.8, 0.6])
    middle = grasps.poses[2, :3, 3] - GRIPPER.finger_reach * grasps.poses[2, :3, 2]
    np.testing.assert_allclose(middle, ON_TABLE + [0.0, 0.0, 0.005], atol=1e-6)

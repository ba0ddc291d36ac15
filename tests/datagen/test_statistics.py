from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from icgnet.datagen.recipe import Recipe, RecipeContacts, RecipeObject, pack_bits
from icgnet.datagen.statistics import count_statistics
from icgnet.grasping.gripper import load_gripper

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0], np.float32)
LEANING = np.array([np.cos(0.25), np.sin(0.25), 0.0, 0.0], np.float32)  # 0.5 rad, 29 degrees


def bits(*rows: Iterable[int]) -> np.ndarray:
    """Packed labels; each row lists its true angles."""
    flags = np.zeros((len(rows), 12), bool)
    for row, angles in enumerate(rows):
        flags[row, list(angles)] = True
    return pack_bits(flags)


def recipe(scene_id: int, kind: str, names: tuple[str, ...], classes: tuple[str, ...], lean: bool = False) -> Recipe:
    """A scene with two contacts on its first object and one on its last; numbers are chosen, not simulated."""
    objects = tuple(
        RecipeObject(name, class_name, 1.0, np.full(3, 0.1, np.float32), LEANING if lean else UPRIGHT)
        for name, class_name in zip(names, classes, strict=True)
    )
    contacts = RecipeContacts(
        positions=np.zeros((3, 3), np.float32),
        normals=np.tile(np.array([1, 0, 0], np.float32), (3, 1)),
        objects=np.array([0, 0, len(objects) - 1]),
        widths=np.array([0.025, 0.0, 0.095], np.float32),
        success=bits((4, 5), (), (5,)),
        collided=bits((0, 1), range(12), (0,)),
        disturbed=bits((4,), (), (7,)),
    )
    return Recipe(scene_id, kind, "things", "train", 0, load_gripper(), objects, contacts)  # pyright: ignore[reportArgumentType]


@pytest.fixture
def recipes() -> list[Recipe]:
    return [
        recipe(0, "packed", ("a", "b"), ("mug", "box")),
        recipe(1, "pile", ("a",), ("mug",)),
        recipe(2, "pile", ("a", "c", "b"), ("mug", "can", "box")),
    ]


def test_scenes_objects_and_labels_are_counted(recipes):
    card = count_statistics(recipes, size=6000)
    assert (card.scenes, card.objects, card.all.contacts, card.all.labels) == (3, 6, 9, 108)
    assert card.bytes_per_scene == 2000
    assert card.scenes_by_kind == {"packed": {"train": 1}, "pile": {"train": 2}}
    assert card.objects_per_scene == {"packed": {2: 1}, "pile": {1: 1, 3: 1}}


def test_shares_are_of_what_they_say(recipes):
    shares = count_statistics(recipes).all
    assert shares.positive == pytest.approx(3 / 36)
    assert shares.collided == pytest.approx(15 / 36)
    assert shares.slipped == pytest.approx(1 - 18 / 36)
    assert shares.disturbed == pytest.approx(1 / 3)  # only successes count, the disturbance of a failure does not
    assert shares.graspable == pytest.approx(2 / 3)


def test_shares_of_a_class_come_from_the_contacts_on_its_objects(recipes):
    card = count_statistics(recipes)
    assert card.objects_by_class == {"mug": 3, "box": 2, "can": 1}
    assert [card.by_class[name].contacts for name in ("mug", "box", "can")] == [7, 2, 0]
    assert card.by_class["box"].positive == pytest.approx(1 / 12)
    assert card.by_class["can"].positive == 0.0


def test_angles_add_up_to_the_whole(recipes):
    card = count_statistics(recipes)
    assert card.angles_deg[0] == -90.0
    for group, shares in {"all": card.all, **card.by_kind}.items():
        angles = card.by_angle[group]
        assert len(angles) == 12
        assert np.mean([each.positive for each in angles]) == pytest.approx(shares.positive)
    assert [card.by_angle["all"][angle].positive for angle in (4, 5, 6)] == pytest.approx([1 / 3, 2 / 3, 0])


def test_widths_of_contacts_without_an_exit_are_left_out(recipes):
    widths = count_statistics(recipes).widths
    assert widths.without == pytest.approx(1 / 3)
    assert widths.percentiles[50] == pytest.approx(0.06, abs=1e-6)
    assert widths.histogram["20 to 30 mm"] == pytest.approx(1 / 3)
    assert widths.histogram["80 mm or more"] == pytest.approx(1 / 3)
    assert sum(widths.histogram.values()) + widths.without == pytest.approx(1)


def test_most_least_and_never_used_names(recipes):
    names = count_statistics(recipes, names=("a", "b", "c", "d")).names
    assert names.used == 3
    assert next(iter(names.most.items())) == ("a", 3)
    assert next(iter(names.least.items())) == ("c", 1)
    assert names.never == ("d",)
    assert count_statistics(recipes).names.never is None


def test_leaning_packed_objects_are_counted_and_leaning_in_a_pile_is_normal(recipes):
    assert count_statistics(recipes).tilted == 0.0
    fallen = recipe(3, "packed", ("a", "b"), ("mug", "box"), lean=True)
    assert count_statistics([*recipes, fallen]).tilted == pytest.approx(0.5)
    assert count_statistics([*recipes, replace(fallen, kind="pile")]).tilted == 0.0

from collections import Counter

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from icgnet.errors import InputError
from icgnet.objects.classes import CLASSES
from icgnet.objects.kinds import CUBE_KINDS, KINDS, SPLITS
from icgnet.objects.model import ObjectModel
from icgnet.objects.object_set import check_kind_and_split, load_object_set
from icgnet.objects.procedural import COUNTS, FAMILIES, SHAPES_VERSION, ProceduralObjectSet

SET = ProceduralObjectSet()


def shape_name(key: str) -> str:
    return key.split("/")[1]


@pytest.fixture(scope="module")
def pile_models() -> list[ObjectModel]:
    """Every shape in its pile size (the packed sizes are stretched copies)."""
    return [SET.model(key) for split in SPLITS for key in SET.names("pile", split)]


def test_at_least_three_hundred_shapes_of_all_seven_classes():
    keys = SET.keys()
    shapes = {shape_name(key): SET.class_name(key) for key in keys}
    assert Counter(shapes.values()) == COUNTS
    assert len(shapes) >= 300
    assert len(set(shapes.values())) == 7


def test_a_tenth_of_each_class_is_val_and_a_tenth_test():
    for split in ("val", "test"):
        counts = Counter(SET.class_name(key) for key in SET.names("pile", split))
        assert counts == {name: count // 10 for name, count in COUNTS.items()}


def test_no_shape_is_in_two_splits():
    shapes = [{shape_name(key) for kind in KINDS for key in SET.names(kind, split)} for split in SPLITS]
    assert not shapes[0] & shapes[1]
    assert not shapes[0] & shapes[2]
    assert not shapes[1] & shapes[2]


def test_names_are_sorted_and_carry_their_kind():
    for kind in CUBE_KINDS:
        names = SET.names(kind, "train")
        assert list(names) == sorted(names)
        assert all(name.startswith(f"{kind}/") for name in names)


def test_packed_scenes_have_every_class():
    assert {SET.class_name(key) for key in SET.names("packed", "train")} == set(COUNTS)


def test_a_shape_depends_on_its_name_alone():
    first, second = ProceduralObjectSet(), ProceduralObjectSet()
    second.model("pile/mug_0003")
    np.testing.assert_array_equal(
        first.model("pile/bottle_0005").visual.vertices, second.model("pile/bottle_0005").visual.vertices
    )


@pytest.mark.slow
def test_all_shapes_are_watertight_and_point_outward(pile_models):
    for model in pile_models:
        assert model.visual.is_watertight, model.name
        assert model.visual.is_winding_consistent, model.name
        components = model.visual.split(only_watertight=False) if model.visual.body_count > 1 else [model.visual]
        assert all(component.volume > 0.0 for component in components), model.name
        assert len(model.visual.faces) <= 1500, model.name
        assert model.visual.area_faces.min() > 1e-12, model.name


@pytest.mark.slow
def test_all_convex_pieces_are_closed_and_have_volume(pile_models):
    for model in pile_models:
        for part in model.parts:
            assert part.is_watertight, model.name
            assert part.volume > 1e-10, model.name


@pytest.mark.slow
def test_convex_pieces_cover_the_surface_and_nothing_else(pile_models):
    for model in pile_models[::5]:
        planes = [ConvexHull(part.vertices).equations for part in model.parts]
        points = np.concatenate([model.visual.triangles_center, model.visual.vertices])
        depth = np.min([(points @ p[:, :3].T + p[:, 3]).max(axis=1) for p in planes], axis=0)
        assert depth.max() < 0.0005, f"{model.name}: surface not covered"
        # without a volume far beyond the visual's, pieces that cover the surface cannot fill hollows
        assert sum(part.volume for part in model.parts) < 1.25 * model.visual.volume, model.name


@pytest.mark.slow
def test_pile_shapes_fit_the_gripper(pile_models):
    for model in pile_models:
        extents = np.sort(model.visual.extents)
        assert 0.037 < extents[1] <= 0.0701 or extents[2] >= 0.2099, model.name
        assert extents[2] <= 0.2101, model.name
        assert extents[0] > 0.006, model.name


@pytest.mark.slow
def test_packed_shapes_stand_between_60_and_200_mm_high():
    for key in SET.names("packed", "val"):
        extents = SET.model(key).visual.extents
        assert 0.06 <= 0.75 * extents[2] <= 0.2, key
        assert min(extents[:2]) <= 0.0921, key


@pytest.mark.slow
def test_origin_is_the_centre_of_mass(pile_models):
    for model in pile_models[::10]:
        np.testing.assert_allclose(model.visual.center_mass, 0.0, atol=1e-9)


def test_mugs_are_hollow():
    hollow = 0
    for key in SET.names("pile", "val"):
        if SET.class_name(key) == "mug":
            model = SET.model(key)
            x, y, _ = model.parts[0].bounds.mean(axis=0)
            below_the_rim = np.array([[x, y, model.visual.bounds[1, 2] - 0.002]])
            hollow += SET.signed_distance(key).distance(below_the_rim)[0] > 0.0
    assert hollow >= 3


def test_every_family_belongs_to_a_known_class():
    # There may be classes that only other object sets have.
    assert set(FAMILIES) == set(COUNTS) <= set(CLASSES)


def test_unknown_object_is_refused_with_similar_names():
    with pytest.raises(InputError, match="did you mean pile/mug_00"):
        SET.model("pile/mug_00033")


def test_unknown_kind_and_split_are_refused():
    with pytest.raises(InputError, match="packed, pile"):
        check_kind_and_split("heap", "train")
    with pytest.raises(InputError, match="train, val, test"):
        check_kind_and_split("pile", "training")


def test_listing_names_makes_no_shape():
    fresh = load_object_set("procedural")
    fresh.class_name(fresh.names("packed", "val")[0])
    assert not fresh._models


SIZES_OF_VERSION_1 = {
    "mug": (0.8616813, 0.0020850354, 0.0022064791),
    "box": (1.2808691, 0.012480781, 0.012480791),
    "can": (0.853334, 0.0085420717, 0.0085450575),
    "bottle": (1.2585308, 0.0117427, 0.011747561),
    "cylindric": (1.4782341, 0.010359501, 0.010431525),
    "ball": (0.28575034, 0.0026944285, 0.0026954585),
    "other": (2.1819931, 0.014327203, 0.01437249),
}
"""Of all shapes of a class in pile sizes: area [m^2], volume, and volume of the convex pieces [m^3]."""


def test_the_shapes_are_those_of_their_version(pile_models):
    """If this fails on purpose, raise `SHAPES_VERSION`: old recipes mean the shapes that they were made with."""
    assert SHAPES_VERSION == 1
    for class_name, sizes in SIZES_OF_VERSION_1.items():
        models = [model for model in pile_models if model.class_name == class_name]
        measured = (
            sum(model.visual.area for model in models),
            sum(model.visual.volume for model in models),
            sum(part.volume for model in models for part in model.parts),
        )
        assert measured == pytest.approx(sizes, rel=1e-6), class_name

from collections import Counter

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from icgnet.errors import InputError
from icgnet.objects.classes import CLASSES
from icgnet.objects.kinds import CUBE_KINDS, KINDS, SPLITS
from icgnet.objects.model import ObjectModel
from icgnet.objects.object_set import check_kind_and_split, load_object_set
from icgnet.objects.procedural import (
    COUNTS,
    FAMILIES,
    SHAPES_VERSION,
    WIDE,
    WIDE_COUNTS,
    WIDE_FAMILIES,
    WIDE_VERSION,
    ProceduralObjectSet,
)
from icgnet.simulation.config import Physics
from icgnet.simulation.physics import Body
from icgnet.simulation.world import World

SET = ProceduralObjectSet()


def shape_name(key: str) -> str:
    return key.split("/")[1]


@pytest.fixture(scope="module")
def pile_models() -> list[ObjectModel]:
    """Every shape in its pile size (the packed sizes are stretched copies)."""
    return [SET.model(key) for split in SPLITS for key in SET.names("pile", split)]


def wide_keys() -> list[str]:
    return sorted(key for split in SPLITS for key in SET.names("table", split) if key.startswith(WIDE))


def word(key: str) -> str:
    return shape_name(key).split("_")[0]


def test_as_many_shapes_of_each_word_as_are_promised_and_all_classes():
    small = {shape_name(key) for kind in CUBE_KINDS for split in SPLITS for key in SET.names(kind, split)}
    assert Counter(name.split("_")[0] for name in small) == COUNTS
    assert Counter(map(word, wide_keys())) == WIDE_COUNTS
    assert {SET.class_name(key) for key in (*wide_keys(), *SET.names("pile", "train"))} == set(CLASSES)


def test_a_tenth_of_each_word_is_val_and_a_tenth_test():
    for split in ("val", "test"):
        counts = Counter(word(key) for key in SET.names("pile", split))
        assert counts == {name: count // 10 for name, count in COUNTS.items()}
        wide = Counter(word(key) for key in SET.names("table", split) if key.startswith(WIDE))
        assert wide == {name: count // 10 for name, count in WIDE_COUNTS.items()}


def test_bowls_and_tools_that_were_called_other_have_their_class_now():
    classes = Counter(SET.class_name(f"pile/other_{number:04d}") for number in range(COUNTS["other"]))
    assert classes["bowl"] >= 4
    assert classes["tool"] >= 10
    assert SET.model("wide/mug_0000").class_name == "mug"
    assert classes["bowl"] + classes["tool"] + classes["other"] == COUNTS["other"]
    for key in SET.names("pile", "train"):
        assert SET.class_name(key) == word(key) or word(key) == "other"


def test_wide_shapes_are_for_tables_and_bins_only():
    for kind in KINDS:
        assert any(key.startswith(WIDE) for key in SET.names(kind, "train")) == (kind in ("table", "bin"))


def test_no_shape_is_in_two_splits():
    shapes = [
        {key if key.startswith(WIDE) else shape_name(key) for kind in KINDS for key in SET.names(kind, split)}
        for split in SPLITS
    ]
    assert not shapes[0] & shapes[1]
    assert not shapes[0] & shapes[2]
    assert not shapes[1] & shapes[2]


def test_names_are_sorted_and_carry_their_kind():
    for kind in CUBE_KINDS:
        names = SET.names(kind, "train")
        assert list(names) == sorted(names)
        assert all(name.startswith(f"{kind}/") for name in names)


def test_packed_scenes_have_every_class():
    assert {word(key) for key in SET.names("packed", "train")} == set(COUNTS)


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
    assert set(WIDE_FAMILIES) == set(WIDE_COUNTS) <= set(CLASSES)
    assert {family.class_name for families in FAMILIES.values() for family in families} == {None, "bowl", "tool"}


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
        models = [model for model in pile_models if word(model.name) == class_name]
        measured = (
            sum(model.visual.area for model in models),
            sum(model.visual.volume for model in models),
            sum(part.volume for model in models for part in model.parts),
        )
        assert measured == pytest.approx(sizes, rel=1e-6), class_name


@pytest.fixture(scope="module")
def wide_models() -> list[ObjectModel]:
    """Every third of the shapes of real sizes."""
    return [SET.model(key) for key in wide_keys()[::3]]


SIZES_OF_WIDE_VERSION_1 = {
    "bowl": (3.8823305, 0.007769128, 0.009379045),
    "mug": (1.1406547, 0.0023995117, 0.0028114315),
    "tool": (1.3471772, 0.0063159903, 0.0063538933),
    "box": (3.8904804, 0.076146443, 0.076146443),
    "other": (2.1869439, 0.0049264048, 0.0060450119),
}
"""Of every third shape: area [m^2], volume, and volume of the convex pieces [m^3]."""


@pytest.mark.slow
def test_the_wide_shapes_are_those_of_their_version(wide_models):
    """If this fails on purpose, raise `WIDE_VERSION`: old recipes mean the shapes that they were made with."""
    assert WIDE_VERSION == 1
    for name, sizes in SIZES_OF_WIDE_VERSION_1.items():
        models = [model for model in wide_models if word(model.name) == name]
        measured = (
            sum(model.visual.area for model in models),
            sum(model.visual.volume for model in models),
            sum(part.volume for model in models for part in model.parts),
        )
        assert measured == pytest.approx(sizes, rel=1e-6), name


@pytest.mark.slow
def test_wide_shapes_are_closed_and_so_are_their_pieces(wide_models):
    for model in wide_models:
        components = model.visual.split(only_watertight=False) if model.visual.body_count > 1 else [model.visual]
        assert model.visual.is_watertight, model.name
        assert model.visual.is_winding_consistent, model.name
        assert all(component.volume > 0.0 for component in components), model.name
        assert len(model.visual.faces) <= 1500, model.name
        assert all(part.is_watertight and part.volume > 1e-10 for part in model.parts), model.name
        assert len(model.parts) <= 80, model.name


@pytest.mark.slow
def test_wide_shapes_are_of_real_sizes(wide_models):
    limits = {"bowl": (0.09, 0.35), "mug": (0.07, 0.18), "tool": (0.1, 0.34), "box": (0.13, 0.33), "other": (0.18, 0.5)}
    for model in wide_models:
        least, most = limits[word(model.name)]
        assert least <= model.visual.extents.max() <= most, model.name


@pytest.mark.slow
def test_convex_pieces_of_wide_shapes_cover_the_surface(wide_models):
    for model in wide_models[::4]:
        planes = [ConvexHull(part.vertices).equations for part in model.parts]
        points = np.concatenate([model.visual.triangles_center, model.visual.vertices])
        depth = np.min([(points @ p[:, :3].T + p[:, 3]).max(axis=1) for p in planes], axis=0)
        assert depth.max() < 0.0005, f"{model.name}: surface not covered"


def inside_pieces(model: ObjectModel, points: np.ndarray) -> np.ndarray:
    planes = [ConvexHull(part.vertices).equations for part in model.parts]
    return np.any([(points @ p[:, :3].T + p[:, 3]).max(axis=1) <= 0.0 for p in planes], axis=0)


def test_a_can_fits_into_a_deep_bowl_and_a_finger_into_a_mug():
    deep = 0
    for key in SET.names("table", "val"):
        if not key.startswith((f"{WIDE}/bowl", f"{WIDE}/mug")):
            continue
        model = SET.model(key)
        top, size = model.visual.bounds[1, 2], model.visual.extents
        if key.startswith(f"{WIDE}/bowl") and size[2] < 0.05:
            continue
        deep += 1
        # Only the handle of a mug breaks the symmetry: the axis of the cup is that of its largest piece, the floor.
        x, y = max(model.parts, key=lambda part: np.prod(part.extents[:2])).bounds.mean(axis=0)[:2]
        free = 0.3 * size.min() if key.startswith(f"{WIDE}/mug") else 0.25 * min(size[:2])
        angle = np.linspace(0.0, 2.0 * np.pi, 24)
        for radius in (0.0, 0.5 * free, free):
            ring = np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle), np.full(24, top - 0.01)])
            assert not inside_pieces(model, ring).any(), key
    assert deep >= 8


def test_a_finger_fits_through_the_handle_of_a_mug():
    for key in [key for key in SET.names("table", "val") if key.startswith(f"{WIDE}/mug")]:
        model = SET.model(key)
        # The handle is in the xz plane, on the +x side: on a line through its hole, along x, air is met within it.
        x = np.arange(model.visual.bounds[1, 0], 0.0, -0.0005)
        middle = np.column_stack([x, np.zeros(len(x)), np.zeros(len(x)) + model.visual.bounds[:, 2].mean()])
        solid = inside_pieces(model, middle)
        outside = np.flatnonzero(solid)[0]
        begin, end = np.argmax(~solid[outside:]), np.flatnonzero(np.diff(solid[outside:].astype(int)) == 1)[0]
        assert 0.0005 * (end - begin) >= 0.015, key


@pytest.mark.slow
def test_wide_shapes_can_be_simulated(wide_models):
    for model in wide_models[::10]:
        World([Body(model, 1.0, np.eye(4))], Physics())

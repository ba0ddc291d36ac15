"""The embedded object set: a thousand random shapes of all classes, made when they are asked for."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from trimesh.transformations import scale_and_translate

from icgnet.objects import containers, sundries, tableware, tools, toys
from icgnet.objects.base import ObjectSet, check_kind_and_split, unknown_object
from icgnet.objects.fingerprint import hash_texts
from icgnet.objects.kinds import CUBE_KINDS, WIDE_KINDS, Kind, Split
from icgnet.objects.model import ObjectModel
from icgnet.objects.solids import Solid

SEED = 20_240_511
"""Changing it (or a family's draws) changes the objects: the set is part of the meaning of every recipe."""

SHAPES_VERSION = 1
"""Raised by every change that alters a shape (a test notices): folders of recipes are not continued with others."""

COUNTS = {"mug": 50, "box": 70, "can": 50, "bottle": 70, "cylindric": 70, "ball": 30, "other": 160}
"""Shapes of each word in the keys, in proportions like those of the VGN set with more mugs and balls."""

WIDE = "wide"
"""First part of the keys of shapes of real sizes, for tables and bins only."""
WIDE_VERSION = 1
"""As `SHAPES_VERSION`, of the wide shapes."""
WIDE_COUNTS = {"bowl": 120, "mug": 60, "tool": 200, "box": 80, "other": 50}
"""Shapes of each class that are of their real sizes."""


@dataclass(frozen=True)
class Family:
    """A kind of shape within a class.

    Attributes:
        make: draws a shape.
        weight: relative frequency within its class.
        stands: whether it keeps standing upright and may be stretched to the height that "packed"
            scenes need.
        class_name: of its shapes; the word in their keys where it is None.
    """

    make: Callable[[np.random.Generator], Solid]
    weight: float = 1.0
    stands: bool = True
    class_name: str | None = None


FAMILIES: dict[str, tuple[Family, ...]] = {
    "mug": (Family(containers.mug, 5.0), Family(containers.jug)),
    "box": (
        Family(containers.carton, 4.0),
        Family(containers.rounded_box, 2.0),
        Family(containers.lidded_box),
        Family(containers.gable_carton),
        Family(containers.tapered_box),
    ),
    "can": (Family(containers.can),),
    "bottle": (Family(containers.bottle, 6.0), Family(containers.handled_bottle)),
    "cylindric": (
        Family(containers.glass, 3.0),
        Family(containers.tall_cylinder, 3.0),
        Family(containers.jar, 2.0),
        Family(containers.prism, 1.5),
        Family(containers.roll, 1.5),
        Family(containers.spool),
    ),
    "ball": (
        Family(containers.ball, 2.0, stands=False),
        Family(containers.faceted_ball, stands=False),
        Family(containers.fruit),
    ),
    "other": (
        Family(sundries.bowl, 2.0, stands=False, class_name="bowl"),
        Family(sundries.pan, stands=False),
        Family(toys.block, 3.0),
        Family(toys.star),
        Family(sundries.hammer, 2.0, stands=False, class_name="tool"),
        Family(sundries.wrench, stands=False, class_name="tool"),
        Family(sundries.screwdriver, stands=False, class_name="tool"),
        Family(sundries.flashlight),
        Family(sundries.banana, 2.0, stands=False),
        Family(sundries.donut, stands=False),
        Family(sundries.horseshoe, stands=False),
        Family(toys.cone),
        Family(sundries.egg, 2.0, stands=False),
        Family(sundries.pear, 2.0),
        Family(sundries.mushroom),
        Family(toys.brick),
        Family(toys.camera),
        Family(toys.toy_car, stands=False),
        Family(toys.shoe),
        Family(toys.house),
        Family(toys.rock, 2.0, stands=False),
        Family(toys.animal, 3.0, stands=False),
        Family(toys.lump, 3.0, stands=False),
        Family(toys.twisted_column, 2.0),
        Family(toys.padlock),
        Family(sundries.dumbbell),
        Family(toys.chair),
        Family(sundries.spoon, stands=False, class_name="tool"),
        Family(sundries.funnel),
    ),
}


WIDE_FAMILIES: dict[str, tuple[Family, ...]] = {
    "bowl": (Family(tableware.bowl, 3.0), Family(tableware.plate, 2.0), Family(tableware.tray)),
    "mug": (Family(tableware.mug),),
    "tool": (
        Family(tools.hammer),
        Family(tools.wrench),
        Family(tools.screwdriver),
        Family(tools.pliers),
        Family(tools.scissors),
        Family(tools.spatula),
        Family(tools.spoon, 1.5),
        Family(tools.knife),
        Family(tools.whisk),
        Family(tools.drill),
    ),
    "box": (Family(tableware.large_box, 2.0), Family(tableware.book)),
    "other": (Family(tableware.pan),),
}


class ProceduralObjectSet(ObjectSet):
    """Shapes with keys "packed/mug_0007" and "pile/mug_0007": the same shape in the sizes of the two scene kinds.

    Shapes with keys "wide/bowl_0001" are of their real sizes, and are for tables and bins only. A shape depends on its
    name alone. One tenth of each word is "val", one tenth "test". Shapes that cannot stand are not in "packed". Some of
    the shapes that are called "other" are of newer classes: bowls and tools.
    """

    def __init__(self) -> None:
        super().__init__("procedural")

    def names(self, kind: Kind, split: Split) -> tuple[str, ...]:
        """Returns the sorted keys of the objects for scenes of `kind` in `split`."""
        check_kind_and_split(kind, split)
        keys = (key for key, shape in _shapes().items() if shape.split == split)
        return tuple(key for key in keys if kind in WIDE_KINDS or key.startswith(f"{kind}/"))

    def class_name(self, key: str) -> str:
        """Returns an object's class without loading it."""
        if key not in _shapes():
            raise unknown_object(self.name, key, _shapes())
        return _shapes()[key].class_name

    def group(self, key: str) -> str:
        """Returns what an object is one of several of: a size of the small shapes, or a class of the wide ones."""
        return key.rpartition("_")[0] if key.startswith(f"{WIDE}/") else super().group(key)

    def fingerprint(self, key: str) -> str:
        """Returns a short hash of the object's name and of the version of the shapes."""
        version = WIDE_VERSION if key.startswith(f"{WIDE}/") else SHAPES_VERSION
        return hash_texts(key, self.class_name(key), f"{SEED} {version}")

    def _load(self, key: str) -> ObjectModel:
        kind, shape = key.split("/")
        word, number = shape.split("_")
        if kind == WIDE:
            family, rng = _draw_wide_family(word, int(number))
            solid = family.make(rng)
            solid = solid.moved(*-solid.surface.center_mass)
        else:
            family, rng = _draw_family(word, int(number))
            solid = fit_to_gripper(family.make(rng), "packed" if kind == "packed" else "pile", rng)
        return ObjectModel(key, self.class_name(key), solid.surface, solid.hulls())


def fit_to_gripper(solid: Solid, kind: Kind, rng: np.random.Generator) -> Solid:
    """Returns the solid scaled so that an 80 mm gripper can hold it, with its centre of mass at the origin.

    "pile": uniformly, until the middle side of the bounding box is 38 to 70 mm and no side is over 210 mm.
    "packed": until the narrow side of the footprint is 48 to 92 mm, no more than 170 mm wide and 260 mm high, then
    stretched upwards if it is lower than 85 mm (packed scenes draw a scale of 0.7 to 0.9 on top).
    """
    narrow, wide = np.sort(solid.extents[:2])
    height = solid.extents[2]
    if kind == "pile":
        _, middle, longest = np.sort(solid.extents)
        factor = min(rng.uniform(0.038, 0.070) / middle, 0.21 / longest)
        scale = np.full(3, factor)
    else:
        factor = min(rng.uniform(0.048, 0.092) / narrow, 0.17 / wide, 0.26 / height)
        stretch = max(1.0, rng.uniform(0.085, 0.12) / (factor * height))
        scale = factor * np.array([1.0, 1.0, stretch])
    return solid.transformed(scale_and_translate(scale, -scale * solid.surface.center_mass))


def _draw_family(word: str, number: int) -> tuple[Family, np.random.Generator]:
    """Returns the family of a shape, and the generator with which it goes on."""
    return _draw_one(FAMILIES[word], np.random.default_rng([SEED, _seed_of(word), number]))


def _draw_wide_family(word: str, number: int) -> tuple[Family, np.random.Generator]:
    """Returns the family of a wide shape, and the generator with which it goes on."""
    return _draw_one(WIDE_FAMILIES[word], np.random.default_rng([SEED, _wide_seed_of(word), number]))


def _draw_one(families: tuple[Family, ...], rng: np.random.Generator) -> tuple[Family, np.random.Generator]:
    weights = np.array([family.weight for family in families])
    return families[rng.choice(len(families), p=weights / weights.sum())], rng


def _seed_of(word: str) -> int:
    """What the draws of a class begin with: its place among the classes that have shapes here."""
    return list(COUNTS).index(word)


def _wide_seed_of(word: str) -> int:
    """The same for the wide shapes: other numbers than those of the small ones."""
    return 1000 + list(WIDE_COUNTS).index(word)


@dataclass(frozen=True)
class _Shape:
    """What is known of a shape before it is made."""

    class_name: str
    split: Split


@cache
def _shapes() -> dict[str, _Shape]:
    """Returns what is known of every key, keys sorted."""
    shapes: dict[str, _Shape] = {}
    for word, count in COUNTS.items():
        for number, split in enumerate(_splits(_seed_of(word), count)):
            family, _ = _draw_family(word, number)
            for kind in CUBE_KINDS:
                if kind == "pile" or family.stands:
                    shapes[f"{kind}/{word}_{number:04d}"] = _Shape(family.class_name or word, split)
    for word, count in WIDE_COUNTS.items():
        for number, split in enumerate(_splits(_wide_seed_of(word), count)):
            shapes[f"{WIDE}/{word}_{number:04d}"] = _Shape(word, split)
    return dict(sorted(shapes.items()))


def _splits(seed: int, count: int) -> list[Split]:
    """Returns the split of each of so many shapes."""
    order = np.random.default_rng([SEED, seed]).permutation(count)
    return ["test" if place < count // 10 else "val" if place < count // 5 else "train" for place in order]

"""What a data set holds, counted from its recipes alone: no mesh is read, no engine runs."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from icgnet.datagen.recipe import Recipe, unpack_bits
from icgnet.geometry.transforms import quaternion_to_matrix
from icgnet.grasping.frame import APPROACH_ANGLES
from icgnet.objects.classes import CLASSES
from icgnet.objects.kinds import KINDS, SPLITS

TILTED = np.deg2rad(20.0)
"""A packed object that leans by more than this has fallen over or leans on another [rad]."""
WIDTH_BINS = 8
"""Bins of 10 mm in the histogram of widths; what is wider goes into one more."""
WIDTH_PERCENTILES = (5, 25, 50, 75, 95)
MOST_NAMES = 5
"""Names listed as the most and the least used."""


@dataclass(frozen=True)
class LabelShares:
    """How many labels there are, and which share of them says what; a share of nothing is 0.

    Attributes:
        contacts: contact points.
        labels: contacts times approach angles.
        positive: share of the labels that are successes.
        collided: share that the check of the approach decided, without physics.
        slipped: share where the hand got there and did not hold the object.
        disturbed: share of the successes that moved another object.
        graspable: share of the contacts with a success at any angle.
    """

    contacts: int
    labels: int
    positive: float
    collided: float
    slipped: float
    disturbed: float
    graspable: float


@dataclass(frozen=True)
class Widths:
    """Distances between the fingers at the contacts.

    Attributes:
        percentiles: percentile -> width [m], of the contacts that have one.
        histogram: bin, as "10 to 20 mm" -> share of the contacts.
        without: share of the contacts behind which the object has no exit.
    """

    percentiles: dict[int, float]
    histogram: dict[str, float]
    without: float


@dataclass(frozen=True)
class NameUse:
    """How often each object of the set was placed.

    Attributes:
        used: names that occur.
        most: the most frequent names with their counts.
        least: the least frequent names that do occur.
        never: names that scenes were drawn from but that do not occur; None where these are not known.
    """

    used: int
    most: dict[str, int]
    least: dict[str, int]
    never: tuple[str, ...] | None


@dataclass(frozen=True)
class Statistics:
    """The numbers of a data set.

    Attributes:
        scenes: number of scenes.
        objects: placed objects in all scenes.
        bytes_per_scene: size on disk.
        scenes_by_kind: kind -> split -> scenes.
        objects_per_scene: kind -> number of objects -> scenes.
        all: labels of the whole set.
        by_kind: labels of each kind of scene.
        by_class: labels on the objects of each class.
        objects_by_class: placed objects of each class.
        angles_deg: the approach angles [degrees].
        by_angle: kind, or "all", -> labels at each of these angles.
        widths: of the contacts.
        names: use of the object set.
        tilted: share of the packed objects that lean by more than 20 degrees.
    """

    scenes: int
    objects: int
    bytes_per_scene: float
    scenes_by_kind: dict[str, dict[str, int]]
    objects_per_scene: dict[str, dict[int, int]]
    all: LabelShares
    by_kind: dict[str, LabelShares]
    by_class: dict[str, LabelShares]
    objects_by_class: dict[str, int]
    angles_deg: tuple[float, ...]
    by_angle: dict[str, tuple[LabelShares, ...]]
    widths: Widths
    names: NameUse
    tilted: float


def count_statistics(
    recipes: Sequence[Recipe],
    size: int = 0,
    names: Iterable[str] | None = None,
) -> Statistics:
    """The statistics of recipes.

    Args:
        recipes: at least one.
        size: of their files [bytes].
        names: all objects that scenes were drawn from, if they are known.
    """
    kinds = [kind for kind in KINDS if any(recipe.kind == kind for recipe in recipes)]
    labels = _Labels(recipes)
    placed = [(recipe, each) for recipe in recipes for each in recipe.objects]
    by_class = Counter(each.class_name for _, each in placed)
    packed = [each.quaternion for recipe, each in placed if recipe.kind == "packed"]
    groups = {"all": np.ones(len(labels), bool)} | {kind: labels.kinds == kind for kind in kinds}
    return Statistics(
        scenes=len(recipes),
        objects=len(placed),
        bytes_per_scene=size / len(recipes),
        scenes_by_kind={kind: _per_split(recipes, kind) for kind in kinds},
        objects_per_scene={kind: _object_histogram(recipes, kind) for kind in kinds},
        all=labels.shares(groups["all"]),
        by_kind={kind: labels.shares(groups[kind]) for kind in kinds},
        by_class={name: labels.shares(labels.classes == name) for name in CLASSES if by_class[name]},
        objects_by_class={name: by_class[name] for name in CLASSES if by_class[name]},
        angles_deg=tuple(np.rad2deg(APPROACH_ANGLES).round(3).tolist()),
        by_angle={
            name: tuple(labels.shares(rows, angle) for angle in range(len(APPROACH_ANGLES)))
            for name, rows in groups.items()
        },
        widths=_width_statistics(np.concatenate([recipe.contacts.widths for recipe in recipes])),
        names=_name_use(Counter(each.name for _, each in placed), names),
        tilted=float((_leans(np.array(packed).reshape(-1, 4)) > TILTED).mean()) if packed else 0.0,
    )


def files_size(directory: Path) -> int:
    """Size of all recipe files in a folder [bytes]."""
    return sum(path.stat().st_size for path in directory.glob("*.parquet"))


class _Labels:
    """The contacts of all scenes in one table, with the kind of their scene and the class of their object."""

    def __init__(self, recipes: Sequence[Recipe]) -> None:
        self.kinds = np.repeat([recipe.kind for recipe in recipes], [len(recipe.contacts) for recipe in recipes])
        self.classes = np.concatenate(
            [np.array([each.class_name for each in recipe.objects])[recipe.contacts.objects] for recipe in recipes]
        )
        self._recipes = recipes

    def __len__(self) -> int:
        return len(self.kinds)

    @cached_property
    def success(self) -> Bool[np.ndarray, "g a"]:
        return np.concatenate([unpack_bits(recipe.contacts.success) for recipe in self._recipes])

    @cached_property
    def collided(self) -> Bool[np.ndarray, "g a"]:
        return np.concatenate([unpack_bits(recipe.contacts.collided) for recipe in self._recipes])

    @cached_property
    def disturbed(self) -> Bool[np.ndarray, "g a"]:
        return np.concatenate([unpack_bits(recipe.contacts.disturbed) for recipe in self._recipes])

    def shares(self, rows: Bool[np.ndarray, "g"], angle: int | None = None) -> LabelShares:
        """Shares of the labels in these rows, at one angle or at all."""
        columns = slice(None) if angle is None else slice(angle, angle + 1)
        success, collided = self.success[rows, columns], self.collided[rows, columns]
        return LabelShares(
            contacts=len(success),
            labels=success.size,
            positive=_share(success),
            collided=_share(collided),
            slipped=_share(~success & ~collided),
            disturbed=_share(self.disturbed[rows, columns][success]),
            graspable=_share(np.any(success, axis=1)),
        )


def _share(flags: Bool[np.ndarray, "*n"]) -> float:
    return float(np.mean(flags)) if flags.size else 0.0


def _per_split(recipes: Sequence[Recipe], kind: str) -> dict[str, int]:
    counts = Counter(recipe.split for recipe in recipes if recipe.kind == kind)
    return {split: counts[split] for split in SPLITS if counts[split]}


def _object_histogram(recipes: Sequence[Recipe], kind: str) -> dict[int, int]:
    return dict(sorted(Counter(len(recipe.objects) for recipe in recipes if recipe.kind == kind).items()))


def _leans(quaternions: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n"]:
    """Angles between the objects' z axes and the vertical [rad]."""
    return np.arccos(np.clip(quaternion_to_matrix(quaternions)[:, 2, 2], -1.0, 1.0))


def _width_statistics(widths: Float[np.ndarray, "g"]) -> Widths:
    known = widths[widths > 0.0]
    bins = np.minimum((known / 0.010).astype(int), WIDTH_BINS)
    shares: Int[np.ndarray, "k"] = np.bincount(bins, minlength=WIDTH_BINS + 1)
    spans = [f"{10 * index} to {10 * index + 10} mm" for index in range(WIDTH_BINS)] + [f"{10 * WIDTH_BINS} mm or more"]
    return Widths(
        percentiles={each: float(np.percentile(known, each)) if len(known) else 0.0 for each in WIDTH_PERCENTILES},
        histogram={span: float(share) for span, share in zip(spans, shares / max(len(widths), 1), strict=True)},
        without=_share(widths <= 0.0),
    )


def _name_use(counts: Counter[str], names: Iterable[str] | None) -> NameUse:
    ranked = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return NameUse(
        used=len(ranked),
        most=dict(ranked[:MOST_NAMES]),
        least=dict(ranked[::-1][:MOST_NAMES]),
        never=None if names is None else tuple(sorted(set(names) - counts.keys())),
    )

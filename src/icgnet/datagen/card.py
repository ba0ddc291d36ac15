"""The data card of a folder of labelled scenes: its statistics and checks as tables, Markdown and JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from icgnet.datagen.checks import Checks, check_scenes
from icgnet.datagen.recipe import Recipe
from icgnet.datagen.statistics import LabelShares, NameUse, Statistics, count_statistics, files_size
from icgnet.errors import DataError, IcgnetError
from icgnet.objects.object_set import ObjectSet, load_object_set

ORIGIN = ("object_set", "split", "scene", "seed", "format_version", "code_version")
"""Entries of the manifest that the card names."""
EMBEDDED = "procedural"

LABEL_COLUMNS = ("contacts", "positive", "collided", "slipped", "disturbed", "graspable")
MOST_NEVER_USED = 20
"""Names of objects that never occur, at most this many are listed."""


@dataclass(frozen=True)
class CardTable:
    """One table of a card; every row has a cell for each column."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class DataCard:
    """What there is to say about a data set.

    Attributes:
        folder: its name.
        origin: entry -> value of the manifest, as far as they are single values: object set, seed, versions.
        statistics: from the recipes.
        checks: against the objects' meshes; None where that was not possible.
        unchecked: why there are no checks, empty if there are.
    """

    folder: str
    origin: Mapping[str, str | int | float]
    statistics: Statistics
    checks: Checks | None
    unchecked: str

    def to_json(self) -> dict[str, object]:
        """All numbers as plain values."""
        return asdict(self)

    def to_markdown(self) -> str:
        """The card as a document."""
        parts = [f"# Data card: {self.folder}"]
        for table in self.tables():
            lines = [table.columns, tuple("---" for _ in table.columns), *table.rows]
            parts.append(f"## {table.title}\n\n" + "\n".join(f"| {' | '.join(line)} |" for line in lines))
        if self.unchecked:
            parts.append(f"## Checks\n\nNo checks and no sheets: {self.unchecked}")
        return "\n\n".join(parts) + "\n"

    def tables(self) -> list[CardTable]:
        """The tables in reading order."""
        statistics = self.statistics
        tables = [
            CardTable("Origin", ("entry", "value"), tuple((key, str(value)) for key, value in self.origin.items())),
            _size_table(statistics),
            _scene_table(statistics),
            _label_table("Labels by kind of scene", {"all": statistics.all} | statistics.by_kind),
            _class_table(statistics),
            _angle_table(statistics),
            _width_table(statistics),
            _name_table(statistics.names),
        ]
        return tables if self.checks is None else [*tables, _check_table(self.checks), _rest_table(self.checks)]


def make_card(
    directory: Path,
    manifest: Mapping[str, object],
    recipes: Sequence[Recipe],
    object_set: ObjectSet | None,
    missing: str,
    checked: int,
    seed: int,
) -> DataCard:
    """The card of a folder of recipes.

    Args:
        directory: the folder.
        manifest: its manifest.
        recipes: its scenes, at least one.
        object_set: the set that they were made of; None for a card without checks.
        missing: why there is no object set.
        checked: scenes to check, drawn at random.
        seed: of that draw.
    """
    objects = manifest.get("objects")
    statistics = count_statistics(recipes, files_size(directory), objects if isinstance(objects, Mapping) else None)
    checks = None
    if object_set is not None:
        sample = [recipes[row] for row in draw_rows(len(recipes), checked, seed)]
        checks = check_scenes(sample, object_set)
    origin = {key: value for key in ORIGIN if isinstance(value := manifest.get(key), str | int | float)}
    return DataCard(directory.resolve().name, origin, statistics, checks, missing)


def draw_rows(count: int, wanted: int, seed: int) -> list[int]:
    """Up to `wanted` different rows of `count`, in ascending order."""
    return sorted(np.random.default_rng(seed).choice(count, min(wanted, count), replace=False).tolist())


def find_objects(
    manifest: Mapping[str, object], recipes: Sequence[Recipe], source: str | None
) -> tuple[ObjectSet | None, str]:
    """The object set that recipes were made of, or None and the reason why it cannot be had.

    Every object that the recipes name must be in it, and be the same as when the recipes were made.

    Args:
        manifest: of the recipes.
        recipes: the scenes.
        source: the set's folder; None is enough for the embedded set.
    """
    name = recipes[0].object_set
    if source is None and name != EMBEDDED:
        return None, f"they need the object set {name!r}: give its folder with --objects"
    try:
        object_set = load_object_set(EMBEDDED if source is None else source)
        _check_same_objects(manifest, recipes, object_set)
    except IcgnetError as error:
        return None, str(error)
    return object_set, ""


def _check_same_objects(manifest: Mapping[str, object], recipes: Sequence[Recipe], object_set: ObjectSet) -> None:
    name = recipes[0].object_set
    if object_set.name != name:
        raise DataError(f"the scenes were made of the object set {name!r}, this one is {object_set.name!r}")
    marks = manifest.get("objects")
    used = sorted({each.name for recipe in recipes for each in recipe.objects})
    changed = [key for key in used if object_set.fingerprint(key) != marks.get(key)] if isinstance(marks, dict) else []
    if changed:
        raise DataError(
            f"objects that have changed since the scenes were made: {len(changed)}, the first one is {changed[0]}"
        )
    for key in used:
        object_set.class_name(key)


def _size_table(statistics: Statistics) -> CardTable:
    rows = [
        ("scenes", str(statistics.scenes)),
        ("objects", str(statistics.objects)),
        ("contacts", str(statistics.all.contacts)),
        ("labels", str(statistics.all.labels)),
        ("bytes a scene", f"{statistics.bytes_per_scene:.0f}"),
        ("packed objects that lean by more than 20 degrees", _percent(statistics.tilted)),
    ]
    return CardTable("Size", ("", "number"), tuple(rows))


def _scene_table(statistics: Statistics) -> CardTable:
    kinds = tuple(statistics.objects_per_scene)
    counts = sorted({count for histogram in statistics.objects_per_scene.values() for count in histogram})
    splits = sorted({split for per_split in statistics.scenes_by_kind.values() for split in per_split})
    rows = [
        (f"split {split}", *(str(statistics.scenes_by_kind[kind].get(split, 0)) for kind in kinds)) for split in splits
    ]
    means = []
    for kind in kinds:
        histogram = statistics.objects_per_scene[kind]
        means.append(f"{sum(count * scenes for count, scenes in histogram.items()) / sum(histogram.values()):.2f}")
    rows.append(("mean number of objects", *means))
    rows += [
        (
            f"with {count} object{'s' * (count != 1)}",
            *(str(statistics.objects_per_scene[kind].get(count, 0)) for kind in kinds),
        )
        for count in counts
    ]
    return CardTable("Scenes", ("scenes", *kinds), tuple(rows))


def _label_table(title: str, groups: Mapping[str, LabelShares], first: str = "") -> CardTable:
    return CardTable(
        title, (first, *LABEL_COLUMNS), tuple((name, *_label_cells(each)) for name, each in groups.items())
    )


def _class_table(statistics: Statistics) -> CardTable:
    rows = [
        (name, str(statistics.objects_by_class[name]), *_label_cells(shares))
        for name, shares in statistics.by_class.items()
    ]
    return CardTable("Classes", ("class", "objects", *LABEL_COLUMNS), tuple(rows))


def _angle_table(statistics: Statistics) -> CardTable:
    groups = tuple(statistics.by_angle)
    columns = [f"{share} ({group})" for share in ("positive", "collided") for group in groups]
    rows = [
        (
            f"{angle:+.1f}",
            *(_percent(statistics.by_angle[group][index].positive) for group in groups),
            *(_percent(statistics.by_angle[group][index].collided) for group in groups),
        )
        for index, angle in enumerate(statistics.angles_deg)
    ]
    return CardTable("Approach angles", ("angle [deg]", *columns), tuple(rows))


def _width_table(statistics: Statistics) -> CardTable:
    widths = statistics.widths
    rows = [(f"percentile {each}", f"{1e3 * width:.1f} mm") for each, width in widths.percentiles.items()]
    rows += [(f"contacts with {span}", _percent(share)) for span, share in widths.histogram.items()]
    rows.append(("contacts without a width", _percent(widths.without)))
    return CardTable("Widths", ("", "value"), tuple(rows))


def _name_table(names: NameUse) -> CardTable:
    rows = [
        ("objects used", str(names.used) + ("" if names.never is None else f" of {names.used + len(names.never)}")),
        ("most often", _counts(names.most)),
        ("least often", _counts(names.least)),
    ]
    if names.never is not None:
        more = len(names.never) - MOST_NEVER_USED
        listed = ", ".join(names.never[:MOST_NEVER_USED]) + (f" and {more} more" if more > 0 else "")
        rows.append(("never", listed or "none"))
    return CardTable("Object names", ("", "names"), tuple(rows))


def _check_table(checks: Checks) -> CardTable:
    rows = []
    for check, result in checks.results.items():
        worst = "-" if result.worst_scene is None else f"{1e3 * result.worst:.1f} mm"
        where = "-" if result.worst_scene is None else f"scene {result.worst_scene}, {result.worst_name}"
        limit = f"{1e3 * result.limit:.0f} mm"
        rows.append((check, str(result.number), limit, f"{100 * result.failed:.2f} %", worst, where))
    columns = ("check", "measured", "limit", "beyond it", "worst", "where")
    return CardTable(f"Checks on {checks.scenes} scenes", columns, tuple(rows))


def _rest_table(checks: Checks) -> CardTable:
    rows = [(f"height of a scene, percentile {each}", f"{1e3 * top:.0f} mm") for each, top in checks.tops.items()]
    rows += [
        ("pairs of touching objects a scene", f"{checks.touching_pairs:.2f}"),
        ("of these, one on the other", f"{checks.stacked_pairs:.2f}"),
    ]
    rows += [(f"longest side, percentile {each}", f"{1e3 * length:.0f} mm") for each, length in checks.lengths.items()]
    rows += [(f"seen of an object, percentile {each}", _percent(share)) for each, share in checks.visible.items()]
    rows.append(("of what is seen above the table, no object", _percent(checks.background)))
    return CardTable("Shape of the scenes", ("", "value"), tuple(rows))


def _label_cells(shares: LabelShares) -> tuple[str, ...]:
    of_labels = (shares.positive, shares.collided, shares.slipped, shares.disturbed, shares.graspable)
    return (str(shares.contacts), *map(_percent, of_labels))


def _counts(names: Mapping[str, int]) -> str:
    return ", ".join(f"{name} ({count})" for name, count in names.items())


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"

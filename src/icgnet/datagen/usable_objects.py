"""Which objects of a set scenes can be made of."""

from collections.abc import Sequence
from dataclasses import dataclass

from icgnet.datagen.config import GenerateConfig
from icgnet.datagen.recipe import MANIFEST
from icgnet.errors import InputError
from icgnet.objects.check import check_object_set
from icgnet.objects.kinds import WIDE_KINDS, Kind
from icgnet.objects.object_set import ObjectSet, load_object_set

NAMED = 5
"""So many objects are named in one sentence."""


@dataclass(frozen=True)
class UsableObjects:
    """An object set without what is broken in it.

    Attributes:
        object_set: the set; its `left_out` says what is not used, and why.
        doubtful: objects that are used although something about them is odd, with what that is.
        never_drawn: for tables and bins, the objects that are too large or too small for any of them, each with its
            longest side.
    """

    object_set: ObjectSet
    doubtful: dict[str, str]
    never_drawn: dict[Kind, dict[str, str]]

    def notices(self) -> list[str]:
        """A line on each object that is left out, one on those that look odd and one on those of the wrong size."""
        lines = self.object_set.notices()
        if self.doubtful:
            lines.append(f"used, but odd (see `doubtful` in {MANIFEST}): {first_of(list(self.doubtful))}")
        for kind, sides in self.never_drawn.items():
            named = first_of([f"{key} ({side})" for key, side in sides.items()])
            lines.append(f"too large or too small for any {kind}, so never drawn for one: {named}")
        return lines


def usable_objects(config: GenerateConfig) -> UsableObjects:
    """The objects that a run can use.

    Raises:
        InputError: there is no such set, or nothing usable in it for one of the kinds of scenes.
        DataError: the set's lists are broken.
    """
    object_set = load_object_set(config.objects)
    keys = {key for kind in config.kinds for key in object_set.names(kind, config.split)}
    problems: dict[str, dict[str, str]] = {"ok": {}, "warning": {}, "broken": {}}
    reports = check_object_set(object_set, sorted(keys))
    for report in reports:
        problems[report.status][report.name] = "; ".join(report.problems)
    if problems["broken"]:
        object_set = object_set.without(problems["broken"])
    for kind in config.kinds:
        if not object_set.names(kind, config.split):
            left_out = list(object_set.left_out)
            raise InputError(
                f"object set {object_set.name!r} has no usable objects for {kind} scenes, split {config.split!r}"
                + (f" ({len(left_out)} left out: {first_of(left_out)})" if left_out else "")
            )
    usable = [report for report in reports if report.status != "broken"]
    never_drawn: dict[Kind, dict[str, str]] = {}
    for kind in config.kinds:
        names = set(object_set.names(kind, config.split))
        sides = {
            report.name: f"{max(report.sides):.2g} m"
            for report in usable
            if kind in WIDE_KINDS and report.name in names and not config.labels.wide.takes(kind, report.sides)
        }
        if sides:
            never_drawn[kind] = sides
    return UsableObjects(object_set, problems["warning"], never_drawn)


def first_of(items: Sequence[str]) -> str:
    """The first few of many items in a sentence, and how many more there are."""
    more = f" and {len(items) - NAMED} more" if len(items) > NAMED else ""
    return ", ".join(items[:NAMED]) + more

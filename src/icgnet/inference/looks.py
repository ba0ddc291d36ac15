"""Two looks at a scene: as it is, and at half its size, in which large objects are as large as those of the training.

The closer look knows small objects and where to grasp; it splits what is larger than anything that the network was
trained on. The wider look sees such an object whole; where it is sure, it decides what belongs together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from icgnet.inference.background import extents
from icgnet.inference.instances import Instance

WIDE_SCALE = 0.5
"""Scale of the wider look."""
SURE = 0.9
"""From this score on an object of the wider look may take the place of what the closer look has there."""
LARGE, TRUST_IN_SIZE = 0.12, 0.5
"""It has to be surer than the objects of the closer look that it joins, or larger than this [m]: a metre more counts as
so much of the score."""
DOUBTED, MARGIN = 0.75, 0.05
"""Scenes that a single window holds are looked at again only if a score there is lower than this, and then it has to be
surer by so much: small things that touch are one object, too, when they are seen at half their size."""
PIECE = 0.08
"""Objects of the closer look with a smaller share of its points are none that it joins."""
UNSEEN = 0.7
"""An object of which this share is in no object of the closer look is taken, however sure."""
REST = 0.5
"""What an object of the closer look has left after more than this share was taken is no object any more."""
FEWEST_POINTS = 10
"""Parts with fewer points are not looked at for grasps."""


@dataclass(frozen=True, eq=False)
class SceneObject:
    """An object of a scene.

    Attributes:
        rows: its points in the tabletop's cloud.
        bodies: the instances that name it and give its shape: one of the wider look, or those of the closer look that
            were joined; the largest comes first.
        parts: what the closer look has of it; grasps are scored with these.
    """

    rows: Int[np.ndarray, "n"]
    bodies: tuple[Instance, ...]
    parts: tuple[Instance, ...]

    @staticmethod
    def joined(pieces: Sequence["SceneObject"]) -> "SceneObject":
        """One object of several pieces, the largest of which comes first."""
        return SceneObject(
            np.sort(np.concatenate([piece.rows for piece in pieces])),
            tuple(body for piece in pieces for body in piece.bodies),
            tuple(part for piece in pieces for part in piece.parts),
        )


def needs_wide_look(close: Sequence[Instance], windows: int) -> bool:
    """Whether there may be objects that the closer look does not know whole: in several windows, or doubted ones."""
    return windows != 1 or any(item.score < DOUBTED for item in close)


def agree(
    close: Sequence[Instance],
    groups: Int[np.ndarray, "i"],
    wide: Sequence[Instance],
    points: Float[np.ndarray, "n 3"],
    margin: float = 0.0,
) -> list[SceneObject]:
    """The objects that both looks make out, the one with most points first; no point belongs to two.

    Args:
        close: instances of the closer look.
        groups: number of the object that each of them belongs to, see `icgnet.inference.parts`.
        wide: instances of the wider look; none if there was none.
        points: the tabletop's cloud [m].
        margin: how much surer than what they join those of the wider look have to be.
    """
    count = len(points)
    label = np.full(count, -1)
    for group, item in zip(groups, close, strict=True):
        label[item.rows] = group
    first_wide = int(groups.max(initial=-1)) + 1
    sizes = np.bincount(label[label >= 0], minlength=first_wide)
    bodies: dict[int, tuple[Instance, ...]] = {
        int(group): tuple(item for each, item in zip(groups, close, strict=True) if each == group) for group in groups
    }
    for number, item in enumerate(sorted(wide, key=lambda each: -each.score), start=first_wide):
        there = label[item.rows]
        if (there < 0).mean() < UNSEEN and not _is_trusted(item, close, points, margin):
            continue
        taken = np.bincount(there[(there >= 0) & (there < first_wide)], minlength=first_wide)
        label[item.rows] = number
        label[np.isin(label, np.flatnonzero((taken > 0) & (taken >= REST * sizes)))] = -1
        bodies[number] = (item,)
    found = []
    for number in np.unique(label[label >= 0]).tolist():
        own = [(item, item.rows[label[item.rows] == number]) for item in close]
        # What sticks out of its window was added from other windows, and is nothing that the query knows.
        parts = tuple(
            replace(item, rows=rows) for item, rows in own if np.isin(rows, item.view.rows).sum() >= FEWEST_POINTS
        )
        found.append(SceneObject(np.flatnonzero(label == number), bodies[number], parts))
    return sorted(found, key=lambda each: -len(each.rows))


def _is_trusted(item: Instance, close: Sequence[Instance], points: Float[np.ndarray, "n 3"], margin: float) -> bool:
    """Whether an object of the wider look is surer than those of the closer look that it joins."""
    if item.score < SURE:
        return False
    shared = np.array([np.isin(item.rows, other.rows, assume_unique=True).sum() for other in close])
    if (shared > PIECE * len(item.rows)).sum() < 2:
        return margin == 0.0  # nothing in a single window is cut by its border
    surety = float(np.average([other.score for other in close], weights=shared))
    return bool(item.score - surety + TRUST_IN_SIZE * (extents(points[item.rows])[2] - LARGE) >= margin)

"""Why candidates of each object were dropped, and the best of them, to be looked at."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from icgnet.grasping.collision import Reason
from icgnet.grasping.grasps import Grasps

LOW_SCORE, TOO_WIDE, UNCHECKED = "low_score", "too_wide", "unchecked"
COLLISIONS = tuple(reason.name.lower() for reason in Reason if reason != Reason.FREE)
REASONS = (LOW_SCORE, TOO_WIDE, *COLLISIONS, UNCHECKED)
"""Why candidates are dropped, in the order in which they are asked; of those unchecked there were enough better ones
or no more time."""
KEPT = 8
"""Of each object and reason so many are kept, each at a contact of its own."""


@dataclass(frozen=True, eq=False)
class Rejections:
    """Why candidates of each object were dropped, and the best of them.

    Attributes:
        counts: how many of each object, by the index of `REASONS`; no rows if that is not known, all 0 if grasps of
            the object were found but not asked for.
        grasps: the best `KEPT` of each object and reason, but none of those unchecked. Of those that are too wide,
            the hand is fully open.
        reasons: of each of these grasps, index of `REASONS`.
    """

    counts: Int[np.ndarray, "o k"]
    grasps: Grasps
    reasons: Int[np.ndarray, "g"]

    @staticmethod
    def empty(objects: int = 0) -> "Rejections":
        """Nothing of so many objects was dropped."""
        counts = np.zeros((objects, len(REASONS)), dtype=np.int64)
        return Rejections(counts, Grasps.empty(), np.zeros(0, dtype=np.int64))

    def total(self) -> dict[str, int]:
        """How many candidates of all objects were dropped, by reason."""
        return dict(zip(REASONS, self.counts.sum(axis=0).tolist(), strict=True))

    def of_object(self, instance_id: int) -> dict[str, int]:
        """How many candidates of one object were dropped, by reason; empty if that is not known."""
        if instance_id >= len(self.counts):
            return {}
        return dict(zip(REASONS, self.counts[instance_id].tolist(), strict=True))

    def for_reason(self, name: str) -> Grasps:
        """The kept grasps that were dropped for one of `REASONS`."""
        return self.grasps.select(self.reasons == REASONS.index(name))

    def transformed(self, T_a_b: Float[np.ndarray, "4 4"]) -> "Rejections":
        """The same with the grasps of frame b in frame a."""
        return replace(self, grasps=self.grasps.transformed(T_a_b))

    def without(self, objects: Int[np.ndarray, "k"]) -> "Rejections":
        """The same with nothing of these objects."""
        counts = self.counts.copy()
        counts[objects[objects < len(counts)]] = 0
        left = ~np.isin(self.grasps.instances, objects)
        return Rejections(counts, self.grasps.select(left), self.reasons[left])

    def of_pieces(self, object_of: Int[np.ndarray, "p"], objects: int) -> "Rejections":
        """The same by object, where it was by piece; `object_of` names the object of every piece."""
        counts = np.zeros((objects, len(REASONS)), dtype=np.int64)
        np.add.at(counts, object_of, self.counts)
        grasps = replace(self.grasps, instances=object_of[self.grasps.instances])
        return _best(Rejections(counts, grasps, self.reasons))

    @staticmethod
    def of_grasps(grasps: Grasps, reasons: Int[np.ndarray, "g"], objects: int) -> "Rejections":
        """Of dropped grasps, and the index of `REASONS` of each.

        Args:
            grasps: all of them; `instances` are numbers of objects.
            reasons: why each was dropped.
            objects: how many objects there are.
        """
        counts = np.zeros((objects, len(REASONS)), dtype=np.int64)
        np.add.at(counts, (grasps.instances, reasons), 1)
        checked = reasons != REASONS.index(UNCHECKED)
        return _best(Rejections(counts, grasps.select(checked), reasons[checked]))

    @staticmethod
    def joined(parts: Sequence["Rejections"]) -> "Rejections":
        """Those of several searches for the same objects; at least one."""
        counts = np.sum([part.counts for part in parts], axis=0)
        grasps = Grasps.concatenate([part.grasps for part in parts])
        return _best(Rejections(counts, grasps, np.concatenate([part.reasons for part in parts])))


def _best(dropped: Rejections) -> Rejections:
    """The same with the best `KEPT` grasps of each object and reason, best first."""
    grasps, order = dropped.grasps, np.argsort(-dropped.grasps.scores, kind="stable")
    # Neighbouring angles at one contact look alike: of these the best one is enough.
    group = grasps.instances * len(REASONS) + dropped.reasons
    _, first = np.unique(np.column_stack([group, grasps.contacts])[order], axis=0, return_index=True)
    order = order[np.sort(first)]
    own = [order[group[order] == each][:KEPT] for each in np.unique(group)]
    kept = np.concatenate([np.zeros(0, dtype=np.int64), *own])
    return replace(dropped, grasps=grasps.select(kept), reasons=dropped.reasons[kept])

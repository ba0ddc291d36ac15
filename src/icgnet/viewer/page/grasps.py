"""Grasps on the page: those that were found, by score, and those that were rejected, by reason."""

from collections import Counter

import numpy as np
from jaxtyping import Int

from icgnet.inference.rejections import REASONS
from icgnet.viewer.describe import REASON_WORDS, best_per_object
from icgnet.viewer.page.hands import Hands
from icgnet.viewer.page.objects import ObjectPanel
from icgnet.viewer.page.stage import Stage
from icgnet.viewer.page.words import reason_legend
from icgnet.viewer.palette import REASON_COLOURS, score_colours

HANDS_PER_OBJECT = 20
SHOWN_AT_FIRST = 2
EVERY_REASON = "all reasons"
REJECTED_OPACITY = 0.6


class GraspPanel:
    """Which grasps are shown: a lowest score, so many of each object, and how hands are drawn."""

    def __init__(self, stage: Stage, objects: ObjectPanel) -> None:
        gui, prediction = stage.server.gui, stage.prediction
        self._found = len(prediction.grasps)
        best = best_per_object(prediction.grasps, HANDS_PER_OBJECT)
        # At the start the threshold hides nothing, so that an unsure prediction does not look like an empty one.
        lowest = float(np.floor(20 * min(best.scores, default=0.0)) / 20)
        with gui.add_folder("Grasps"):
            self._threshold = gui.add_slider("Lowest score", 0.0, 1.0, 0.01, min(max(lowest, 0.0), 1.0))
            self._count = gui.add_slider("Per object", 0, HANDS_PER_OBJECT, 1, SHOWN_AT_FIRST)
            self._whole = gui.add_checkbox("Whole hand", False)
            self._told = gui.add_markdown("")
        stage.watch(self._threshold, self._count, self._whole)
        self._rank = _ranks(best.instances)
        self.hands = Hands(
            stage.server,
            "hands",
            best.transformed(stage.T_table_frame),
            prediction.gripper,
            score_colours(best.scores),
            None,
            lambda g: objects.pick(best, g, None),
        )

    @property
    def per_object(self) -> int:
        """How many grasps of an object are shown."""
        return int(self._count.value)

    @property
    def whole(self) -> bool:
        """Whether hands are drawn as large as they are."""
        return bool(self._whole.value)

    def update(self, shown: frozenset[int]) -> None:
        """Shows the grasps of these objects that were asked for."""
        grasps = self.hands.grasps
        wanted = np.isin(grasps.instances, list(shown))
        wanted &= (grasps.scores >= self._threshold.value) & (self._rank < self.per_object)
        self.hands.show(wanted, self.whole)
        self._told.content = f"{wanted.sum()} of {self._found} grasps are shown"


class RejectedPanel:
    """Whether rejected grasps are shown, and of which reason; as many of each object as of those that were found."""

    def __init__(self, stage: Stage, objects: ObjectPanel) -> None:
        gui, prediction = stage.server.gui, stage.prediction
        dropped = prediction.rejections
        self._reasons = dropped.reasons
        counts = {name: count for name, count in prediction.rejected.items() if count}
        kept = [name for name in REASONS if (dropped.reasons == REASONS.index(name)).any()]
        self._words = {f"{REASON_WORDS[name]} ({counts.get(name, 0)})": name for name in kept}
        with gui.add_folder("Rejected grasps"):
            self._switch = gui.add_checkbox("Show rejected", False, disabled=not kept)
            self._reason = gui.add_dropdown("Reason", [EVERY_REASON, *self._words], disabled=not kept)
            if not kept:
                gui.add_markdown("none were saved; predict again" if counts else "none")
            self._legend = gui.add_html(reason_legend([(name, words) for words, name in self._words.items()]))
        stage.watch(self._switch, self._reason)
        self._rank = _ranks(dropped.grasps.instances * len(REASONS) + dropped.reasons)
        self.hands = Hands(
            stage.server,
            "rejected",
            dropped.grasps.transformed(stage.T_table_frame),
            prediction.gripper,
            np.array([REASON_COLOURS[REASONS[reason]] for reason in dropped.reasons]).reshape(-1, 3),
            REJECTED_OPACITY,
            lambda g: objects.pick(dropped.grasps, g, REASON_WORDS[REASONS[dropped.reasons[g]]]),
        )

    def update(self, shown: frozenset[int], per_object: int, whole: bool) -> None:
        """Shows the rejected grasps of these objects that were asked for."""
        wanted = np.isin(self.hands.grasps.instances, list(shown)) & (self._rank < per_object)
        if self._reason.value != EVERY_REASON:
            wanted &= self._reasons == REASONS.index(self._words[self._reason.value])
        is_on = bool(self._switch.value)
        self.hands.show(wanted & is_on, whole)
        self._legend.visible = is_on


def _ranks(groups: Int[np.ndarray, "g"]) -> Int[np.ndarray, "g"]:
    """How many of the same group stand before each."""
    seen: Counter[int] = Counter()
    ranks = np.zeros(len(groups), dtype=np.int64)
    for g, group in enumerate(groups.tolist()):
        ranks[g] = seen[group]
        seen[group] += 1
    return ranks

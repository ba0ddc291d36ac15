"""Settings of the search for grasps."""

from dataclasses import dataclass
from typing import Literal

from icgnet.settings import check_choices, check_range


@dataclass(frozen=True)
class GraspSearch:
    """How objects and grasps are looked for."""

    contacts: int = 512
    """Contact points that are scored, shared among the objects; of many objects 128 of each."""
    min_score: float = 0.05
    """Candidates with a lower score are dropped."""
    select: Literal["best", "highest"] = "best"
    """Which grasps come first: those with the best scores; or the highest ones above 0.9, then those above 0.8, then
    above 0.7, and no others (the rule of the paper's robot)."""
    per_object: int = 16
    """Collision-free grasps after which an object has enough; not with select highest."""
    most: int | None = None
    """Collision-free grasps, of all objects together, after which the search ends; None for no such end."""
    budget_ms: float | None = None
    """About how long a prediction may take [ms]: the best grasps are checked first; the result says what was left out.
    Then it depends on the clock. None for as long as it takes."""
    max_checked: int = 2048
    """Candidates that are checked for collision at most."""
    width_from: Literal["network", "shape"] = "network"
    """Whether the object's width comes from the network or from a ray through the predicted shape."""
    opening: Literal["predicted", "full"] = "predicted"
    """How far the hand is open on its way: as far as the object's width needs, or fully."""
    spare_opening: float = 0.02
    """So much farther the hand is opened than the predicted width needs, where that touches nothing [m]."""
    resample: bool = True
    """Score points of the predicted surfaces, too: of all objects when the seen points give too few good grasps, else
    of those without a grasp, unless `most` ends the search."""
    few: int = 5
    """Fewer good grasps than this, of all objects together, are too few."""
    good_score: float = 0.5
    """A grasp is good from this score on."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_range(self, 1.0, "contacts", "per_object", "max_checked", "most")
        check_range(self, 0.0, "few", "spare_opening")
        check_range(self, 1.0, "budget_ms")
        check_range(self, 0.0, "min_score", "good_score", most=1.0)


DEFAULT_SEARCH = GraspSearch()
"""What the predictor searches with."""

BEST_FEW = GraspSearch(most=5)
"""When only the best grasp is executed: with the five best known, the search for more decides as if it knew all."""

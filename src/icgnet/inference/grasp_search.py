"""Settings of the search for grasps."""

from dataclasses import dataclass
from typing import Literal, get_args

from icgnet.errors import InputError

Opening = Literal["predicted", "full"]


@dataclass(frozen=True)
class GraspSearch:
    """How objects and grasps are looked for."""

    merge_parts: Literal["auto", "always", "never"] = "auto"
    """Join objects whose common border is smooth; auto does so in scenes of several windows, which cut things."""
    contacts: int = 512
    """Contact points that are scored for each window of 0.3 m, shared among its objects."""
    min_score: float = 0.1
    """Candidates with a lower score are dropped."""
    per_object: int = 16
    """Collision-free grasps after which an object has enough."""
    most: int | None = None
    """Collision-free grasps, of all objects together, after which the search ends; None for no such end."""
    max_checked: int = 2048
    """Candidates that are checked for collision at most."""
    width_from: Literal["network", "shape"] = "network"
    """Whether the object's width comes from the network or from a ray through the predicted shape."""
    opening: Opening = "predicted"
    """How far the hand is open on its way: as far as the object's width needs, or fully."""
    resample: bool = True
    """Score points of the predicted surfaces, too, when the seen points give too few good grasps."""
    few: int = 5
    """Fewer good grasps than this are too few."""
    good_score: float = 0.5
    """A grasp is good from this score on."""

    def __post_init__(self) -> None:
        for name in ("contacts", "per_object", "max_checked", "most"):
            if getattr(self, name) is not None and getattr(self, name) < 1:
                raise InputError(f"{name} must be at least 1, got {getattr(self, name)}")
        for name in ("min_score", "good_score"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise InputError(f"{name} must be a probability between 0 and 1, got {getattr(self, name)}")
        if self.merge_parts not in ("auto", "always", "never"):
            raise InputError(f"merge_parts must be 'auto', 'always' or 'never', got {self.merge_parts!r}")
        if self.width_from not in ("network", "shape"):
            raise InputError(f"width_from must be 'network' or 'shape', got {self.width_from!r}")
        if self.opening not in get_args(Opening):
            raise InputError(f"opening must be one of {', '.join(get_args(Opening))}, got {self.opening!r}")


DEFAULT_SEARCH = GraspSearch()
"""What the predictor searches with."""

BEST_FEW = GraspSearch(most=5)
"""When only the best grasp is executed: with the five best known, the search for more decides as if it knew all."""

"""How a pick is planned."""

from dataclasses import dataclass
from typing import Literal

from icgnet.errors import InputError
from icgnet.settings import check_choices, check_range

Source = Literal["shapes", "points"]
FARTHEST_BACK, HIGHEST_LIFT = 0.16, 0.2
"""How far the straight line before a grasp and the one after it may go [m]."""
HIGHEST_FALL = 1.0
"""Nothing is dropped from higher above the support [m]."""


@dataclass(frozen=True)
class PickSettings:
    """How a pick is planned."""

    obstacles: Source = "shapes"
    """What objects are for the arm: their predicted shapes, or no more than their measured points."""
    release: Literal["drop", "place"] = "drop"
    """Whether the object falls from the drop-off point, or is lowered onto it."""
    drop_above: float | None = None
    """For a drop-off that is lower than the support, beside it (a box on the floor): the object falls from this height
    above the support [m]. If not given, such a place is refused."""
    check_carried: bool = True
    """Whether the predicted shape of the carried object must meet nothing."""
    margin: float = 0.005
    """Distance from everything on the ways between straight lines [m]."""
    carried_margin: float = 0.004
    """The carried object keeps so much more from everything, from the lift on [m]: its shape is not known exactly, and
    it turns a little in the hand. What is nearer where it stands, it need only leave."""
    approach: float = 0.06
    """The hand comes in straight over at least this distance [m]."""
    lift: float = 0.10
    """The object is lifted straight by at least this, and lowered by this where it is placed [m]."""
    speed: float = 1.0
    """Share of the arm's largest velocities."""
    line_speed: float = 0.5
    """The same on straight lines."""
    most_grasps: int = 100
    """So many grasps are tried at most."""
    clearances: bool = False
    """Measure how near anything comes to anything in each phase, which decides nothing and takes most of the time."""
    budget_ms: float | None = None
    """Once planning took longer, no further grasp is tried [ms]; the first one always is. None for no limit."""
    seed: int = 0
    """Of everything that is drawn."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_range(self, 0.001, "margin", most=0.05)
        check_range(self, 0.0, "carried_margin", most=0.02)
        check_range(self, 0.0, "drop_above", most=HIGHEST_FALL)
        if self.drop_above is not None and self.release == "place":
            raise InputError("drop_above is for release drop: below the support nothing can be placed")
        check_range(self, 0.02, "approach", most=FARTHEST_BACK)
        check_range(self, 0.02, "lift", most=HIGHEST_LIFT)
        check_range(self, 0.01, "speed", "line_speed", most=1.0)
        check_range(self, 1.0, "most_grasps")
        check_range(self, 1.0, "budget_ms")
        check_range(self, 0.0, "seed")


DEFAULT_PICK = PickSettings()
"""How a pick is planned unless something else is asked for."""

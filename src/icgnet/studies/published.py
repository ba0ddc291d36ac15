"""What the published simulators do, for comparison. Sources are named; nothing here steers our simulation."""

from dataclasses import dataclass

from icgnet.objects.kinds import Kind


@dataclass(frozen=True)
class PublishedScenes:
    """Scenes of five objects of the VGN test sets, made by the published benchmark code (60 scenes each).

    Attributes:
        placed: objects left, mean.
        lost: objects that left the workspace, a scene.
        rejected: share of attempts without room; None for piles.
        tilted: share of objects tilted by more than 20 degrees; None for piles.
    """

    placed: float
    lost: float
    rejected: float | None
    tilted: float | None


SCENES: dict[Kind, PublishedScenes] = {
    "packed": PublishedScenes(placed=3.60, lost=0.03, rejected=0.67, tilted=0.04),
    "pile": PublishedScenes(placed=4.48, lost=0.52, rejected=None, tilted=None),
}
"""The benchmark of Edge-Grasp-Network and of the paper, PyBullet at 80 Hz."""

PILE_FELL_THROUGH = 0.37
"""Of the lost pile objects, those (a scene) that sink through the published 12 mm table at 80 Hz; see decision 0007."""


@dataclass(frozen=True)
class PublishedTrace:
    """A grasp from above in the published benchmark (80 Hz, objects of 0.5 kg).

    Attributes:
        name: key in the VGN object set.
        scale: of the object.
        width: opening of the hand after the lift [m].
    """

    name: str
    scale: float
    width: float


TRACES = (
    PublishedTrace("packed/chips_can", 0.75, 0.0617),
    PublishedTrace("packed/pudding_box", 0.75, 0.036),
    PublishedTrace("pile/soccer_ball_poisson_000", 0.9, 0.065),
    PublishedTrace("pile/jar_poisson_004", 0.9, 0.0588),
    PublishedTrace("pile/boot_poisson_005", 0.9, 0.0249),
    PublishedTrace("pile/ChocSticks_800_tex", 0.9, 0.0155),
)
TRACE_RISE = 0.0917
"""How far the published hand, which lags 8 mm behind its target, has lifted the can when success is read [m]."""

TRACE_STANDOFF = 0.0027
"""Space that PyBullet leaves between pads and objects [m]: four hulls are inflated by 1 mm each, and the soft pads
(20 N on 30 kN/m) give 0.67 mm each. MuJoCo's surfaces touch."""

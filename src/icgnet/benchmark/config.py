"""What decides the numbers of the clutter benchmark."""

from dataclasses import dataclass, field
from typing import Literal, get_args

from icgnet.benchmark.observation import NoiseName, ViewName
from icgnet.benchmark.planners.registry import PlannerSource
from icgnet.errors import InputError
from icgnet.objects.kinds import KINDS, SPLITS, Kind, Split
from icgnet.simulation.workcell import PROTOCOLS

OpeningName = Literal["full", "predicted"]


@dataclass(frozen=True)
class ClutterConfig:
    """What decides the numbers of a benchmark.

    Attributes:
        planner: what is tested.
        scene: kind of scenes.
        objects: source of the object set.
        split: which objects.
        view: where the camera may stand.
        noise: what the sensor does.
        protocol: what counts as a success.
        opening: how far the hand is open while it approaches: fully, or as the planner says; None for what is usual in
            the protocol (edge: full, strict: predicted).
        runs: how often the rounds are repeated, with other scenes.
        rounds: scenes of a run.
        seed: of every random draw.
    """

    planner: PlannerSource = field(default_factory=PlannerSource)
    scene: Kind = "packed"
    objects: str = "procedural"
    split: Split = "test"
    view: ViewName = "random"
    noise: NoiseName = "gaussian"
    protocol: str = "edge"
    opening: OpeningName | None = None
    runs: int = 4
    rounds: int = 100
    seed: int = 1

    def __post_init__(self) -> None:
        choices = {
            "scene": KINDS,
            "split": SPLITS,
            "view": get_args(ViewName),
            "noise": get_args(NoiseName),
            "protocol": tuple(PROTOCOLS),
            "opening": (None, *get_args(OpeningName)),
        }
        for name, valid in choices.items():
            if getattr(self, name) not in valid:
                names = ", ".join(str(each) for each in valid if each is not None)
                raise InputError(f"{name} must be one of {names}, got {getattr(self, name)!r}")
        for name, least in (("runs", 1), ("rounds", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise InputError(f"{name} must be at least {least}, got {getattr(self, name)}")

    @property
    def full_opening(self) -> bool:
        """Whether the hand approaches fully opened."""
        opening = self.opening or ("full" if self.protocol == "edge" else "predicted")
        return opening == "full"

"""What decides the numbers of the benchmarks; nothing heavy is imported here."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from icgnet.arm.settings import Source
from icgnet.errors import InputError
from icgnet.inference.grasp_search import BEST_FEW, GraspSearch
from icgnet.objects.kinds import WIDE_KINDS, Kind, Split
from icgnet.settings import check_choices, check_range
from icgnet.simulation.config import WideScenes

ViewName = Literal["random", "side", "top"]
NoiseName = Literal["none", "gaussian", "dex", "stereo"]
OUR_NETWORK = "icgnet"
NOTHING_FOUND = "nothing found"
"""How a picture ends without a grasp, beside the causes of failed attempts."""
OCCLUSION_GROUPS = {"0 to 0.5": (0, 5), "0.5 to 0.9": (5, 9), "all": (0, 9)}
"""Targets that are counted together: first tenth of occlusion, and the first one that is no more among them."""
WIDE = WideScenes(objects=(3, 12), stored=0.0)
"""Tables and bins of the benchmarks; of so many objects are tried, fewer where the support is small."""
EVERY, IN_LABELS, IN_CLICKS = "all", "all with label images", "all with clicks"
"""Groups of real frames, beside the subsets; the last two if there are frames of both kinds."""


@dataclass(frozen=True, kw_only=True)
class SceneConfig:
    """Scenes and pictures, the same for every benchmark with the same values."""

    objects: str = "procedural"
    """'procedural', or a folder of URDFs (VGN layout) or meshes."""
    scene: Kind = "packed"
    """Kind of scenes."""
    split: Split = "test"
    """Which objects: val for choosing, test for reporting."""
    view: ViewName = "random"
    """Where the camera stands; tables and bins have a view of their own, which is random."""
    noise: NoiseName = "gaussian"
    """What the sensor does."""
    seed: int = 1
    """Of every random draw."""
    gripper: str = "franka"
    """Name of a hand that ships with the package, or a gripper file; the network must know it."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_range(self, 0.0, "seed")
        if self.scene in WIDE_KINDS and self.view != "random":
            raise InputError(f"view must be random in {self.scene} scenes, got {self.view!r}")

    def describe(self) -> str:
        """What stands above the numbers."""
        return (
            f"{self.scene} scenes of {self.split} objects from {self.objects}, view {self.view}, noise {self.noise}, "
            f"hand {self.gripper}, seed {self.seed}"
        )


@dataclass(frozen=True, kw_only=True)
class PlannerConfig(SceneConfig):
    """A planner that is given pictures of scenes."""

    planner: str = OUR_NETWORK
    """icgnet, antipodal, random, oracle, or module:Class of your own."""
    weights: Path | None = None
    """Weights file for icgnet; the one that ships with the package if not given."""
    threads: int = 1
    """CPU threads of icgnet's network in each process."""
    search: GraspSearch = BEST_FEW
    """How icgnet looks for grasps; how far the hand opens is said by --opening."""
    level_table: bool = True
    """For icgnet, in packed and pile: take out a wrong depth scale, which the known height of the table tells."""
    opening: Literal["full", "predicted"] | None = None
    """How far the hand is open while it approaches; full in the protocol edge, predicted in strict, if not given."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range(self, 1.0, "threads")
        if self.search.opening != BEST_FEW.opening:
            raise InputError(f"search.opening has no effect here: give opening {self.search.opening!r} instead")
        usual = {"weights": None, "threads": 1, "search": BEST_FEW, "level_table": True}
        given = [name for name, value in usual.items() if getattr(self, name) != value]
        if given and self.planner != OUR_NETWORK:
            raise InputError(f"only the planner {OUR_NETWORK} takes {', '.join(given)}, not {self.planner!r}")

    @property
    def full_opening(self) -> bool:
        """Whether the hand approaches fully opened."""
        return self.opening == "full"

    def describe(self) -> str:
        """What stands above the numbers."""
        return f"{self.planner}: {super().describe()}"

    def decisive(self) -> dict[str, Any]:
        """What the rounds depend on; how many threads compute decides nothing."""
        values = asdict(self)
        del values["threads"], values["search"]["opening"]
        if self.planner != OUR_NETWORK:
            del values["weights"], values["search"], values["level_table"]
        return {**values, "full_opening": self.full_opening}


@dataclass(frozen=True, kw_only=True)
class ClutterConfig(PlannerConfig):
    """Let a planner grasp scenes empty, and count."""

    protocol: Literal["edge", "strict"] = "edge"
    """What counts as a success: the published rules, or a free approach and the right object held."""
    runs: int = 4
    """How often the rounds are repeated, with other scenes."""
    rounds: int = 100
    """Scenes of a run."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range(self, 1.0, "runs", "rounds")

    @property
    def full_opening(self) -> bool:
        """Whether the hand approaches fully opened."""
        opening = self.opening or ("full" if self.protocol == "edge" else "predicted")
        return opening == "full"

    def describe(self) -> str:
        """What stands above the numbers."""
        opening = "full" if self.full_opening else "predicted"
        return f"{super().describe()}, protocol {self.protocol}, opening {opening}"


@dataclass(frozen=True, kw_only=True)
class TargetConfig(PlannerConfig):
    """Let a planner grasp one named object, hidden more or less by others, in one attempt with the rules strict."""

    scene: Kind = "table"
    """Kind of scenes."""
    noise: NoiseName = "stereo"
    """What the sensor does."""
    opening: Literal["full", "predicted"] | None = None
    """How far the hand is open while it approaches; predicted if not given."""
    scenes: int = 100
    """In each, one object of every tenth of occlusion from 0 to 0.9 is tried that the hand could hold if alone."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range(self, 1.0, "scenes")


@dataclass(frozen=True, kw_only=True)
class PictureConfig(SceneConfig):
    """The first pictures of the scenes of run 0 of the clutter benchmark, and the network that sees them."""

    scenes: int = 20
    """How many scenes, with one picture each."""
    weights: Path | None = None
    """Weights file; the one that ships with the package if not given."""
    threads: int | None = None
    """CPU threads of the network."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range(self, 1.0, "scenes", "threads")


@dataclass(frozen=True, kw_only=True)
class LatencyConfig(PictureConfig):
    """Time of each stage from a cloud or depth image to ranked, collision-checked grasps; size of the model."""

    scenes: int = 5
    """How many scenes, with one picture each."""
    repeats: int = 10
    """Timed predictions of each picture, after an untimed one."""
    input: Literal["cloud", "depth"] = "cloud"
    """What is given to the predictor: the fused cloud of the objects, or the depth image with the table."""
    wide: WideScenes = WIDE
    """What tables and bins are like; as in the clutter benchmark, if not given."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range(self, 1.0, "repeats")

    def describe(self) -> str:
        """What stands above the numbers."""
        return f"{super().describe()}, input {self.input}"


@dataclass(frozen=True, kw_only=True)
class CapturesConfig:
    """Real frames with labels or clicks, and the network that sees them."""

    folder: Path
    """Searched for frames, also in the folders inside of it; docs/guides/real_captures.md has the formats."""
    weights: Path | None = None
    """Weights file; the one that ships with the package if not given."""
    threads: int = 2
    """CPU threads of the network."""
    pose: bool = True
    """Whether the camera's pose is used where it is known."""

    def __post_init__(self) -> None:
        check_range(self, 1.0, "threads")

    def describe(self) -> str:
        """What stands above the numbers."""
        poses = "poses where they are known" if self.pose else "without poses"
        return f"{self.folder}, {self.weights or 'the weights of the package'}, {self.threads} threads, {poses}"


@dataclass(frozen=True, kw_only=True)
class WorkcellConfig:
    """Let a simulated arm with a camera on its wrist clear a table into a box, or fetch one object, and count."""

    objects: str = "procedural"
    """'procedural', or a folder of URDFs (VGN layout) or meshes."""
    scene: Kind = "packed"
    """Kind of scenes."""
    split: Split = "test"
    """Which objects: val for choosing, test for reporting."""
    rounds: int = 100
    """Scenes that are played."""
    seed: int = 1
    """Of every random draw."""
    gripper: str = "franka"
    """Name of a hand that ships with the package, or a gripper file; the network must know it."""
    arm: str = "fr3"
    """Name of an arm that ships with the package, or an arm file."""
    planner: Literal["icgnet", "oracle"] = OUR_NETWORK
    """Who finds objects and grasps: the network, or one who knows the true shapes and tries grasps in simulation."""
    weights: Path | None = None
    """Weights file for icgnet; the one that ships with the package if not given."""
    threads: int = 1
    """CPU threads of icgnet's network in each process."""
    noise: Literal["none", "stereo"] = "stereo"
    """What the camera does: nothing, or what a RealSense D415 does."""
    hand_eye_error: bool = True
    """Whether the camera is 2 mm and 0.3 degrees from where it is believed to be; in which direction is drawn."""
    obstacles: Source = "shapes"
    """What objects are for the arm: their shapes, or no more than their measured points."""
    attached_check: bool = True
    """Whether the shape of the carried object must meet nothing."""
    pool: int = 17
    """So many objects of the set are drawn once, and all scenes are made of them."""
    fetch: bool = False
    """Fetch one object that others hide, each scene twice: taking away what blocks it, and taking the highest first."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_range(self, 0.0, "seed")
        check_range(self, 1.0, "rounds", "threads", "pool")
        usual = {"weights": None, "threads": 1}
        given = [name for name, value in usual.items() if getattr(self, name) != value]
        if given and self.planner != OUR_NETWORK:
            raise InputError(f"only the planner {OUR_NETWORK} takes {', '.join(given)}, not {self.planner!r}")

    def describe(self) -> str:
        """What stands above the numbers."""
        check = "with" if self.attached_check else "without"
        return (
            f"{self.planner} on {self.arm}: {self.scene} scenes of {self.pool} {self.split} objects from "
            f"{self.objects}, noise {self.noise}, hand-eye error {'on' if self.hand_eye_error else 'off'}, "
            f"obstacles {self.obstacles}, {check} the carried shape checked, hand {self.gripper}, seed {self.seed}"
        )

    def decisive(self) -> dict[str, Any]:
        """What the rounds depend on; how many threads compute decides nothing."""
        values = asdict(self)
        del values["threads"]
        if self.planner != OUR_NETWORK:
            del values["weights"]
        return values

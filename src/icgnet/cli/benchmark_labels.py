"""`icgnet benchmark label-ceiling`: how good scores of grasps can be."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rich.console import Console
from rich.table import Table

from icgnet.benchmark.record import write_report
from icgnet.cli.notices import load_objects

if TYPE_CHECKING:
    from icgnet.objects.kinds import Kind


@dataclass(frozen=True)
class LabelCeilings:
    """The best that scores of grasps can reach against labels that are one draw of a jittered trial."""

    objects: str = "procedural"
    """Object set of the scenes."""
    split: Literal["train", "val", "test"] = "val"
    """Which objects the scenes are made of."""
    scenes: int = 30
    """Scenes of each kind."""
    repeats: int = 8
    """How often each trial is repeated, with other jitter, mass and friction."""
    contacts: int = 16
    """Contacts of each scene; each is tried at all angles."""
    seed: int = 0
    """Of the scenes and trials."""
    out: Path | None = None
    """Folder for report.json."""

    def run(self) -> None:
        """Measures, and prints a table.

        Raises:
            IcgnetError: no such objects, or settings out of range.
        """
        from icgnet.benchmark.label_ceiling import measure_ceiling
        from icgnet.grasping.gripper import load_gripper

        object_set, gripper = load_objects(self.objects), load_gripper()
        table = Table("scenes", "trials", "success", "both outcomes", "F1 at best", "top 1", title="ceiling of scores")
        ceilings = []
        kinds: "tuple[Kind, ...]" = ("packed", "pile")
        for kind in kinds:
            found = measure_ceiling(
                kind, object_set, self.split, gripper, self.scenes, self.repeats, self.contacts, self.seed
            )
            ceilings.append(asdict(found))
            shares = (found.success, found.undecided, found.f1, found.top1)
            table.add_row(f"{kind} {found.scenes}", str(found.trials), *(f"{share:.3f}" for share in shares))
        Console().print(table)
        settings = {"objects": self.objects, "split": self.split, "seed": self.seed}
        write_report(self.out, {"benchmark": "label-ceiling", "settings": settings, "ceilings": ceilings})

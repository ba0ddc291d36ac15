"""`icgnet curves`: a picture of how training runs went."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro
from rich.console import Console

from icgnet.errors import InputError


@dataclass(frozen=True)
class Curves:
    """Draw loss and validation of one or several training runs into one picture."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders that `icgnet train` wrote, or log files (metrics.jsonl, under any name)."""
    out: Path = Path("curves.png")
    """Picture to write, ending in .png."""
    over: Literal["visits", "minutes"] = "visits"
    """What the curves are drawn over: scenes visited, or minutes of training."""

    def run(self) -> None:
        """Draws.

        Raises:
            IcgnetError: something that is not the log of a training run.
        """
        if self.out.suffix != ".png":
            raise InputError(f"the picture must end in .png, got {self.out.name!r}")
        from icgnet.viewer.training_curves import draw_curves, read_run

        draw_curves([read_run(path) for path in self.runs], self.out, self.over)
        Console().print(f"written to {self.out}", soft_wrap=True)

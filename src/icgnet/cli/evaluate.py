"""`icgnet evaluate`: how good weights are on generated scenes of held-out objects."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True)
class Evaluate:
    """Print the metrics of weights on generated scenes: grasps, shapes, instances and classes."""

    data: tuple[Path, ...]
    """Folders that `icgnet generate` wrote, with objects that the weights were not trained on."""
    objects: tuple[str, ...] = ("procedural",)
    """The object sets that the scenes were made of."""
    weights: Path | None = None
    """Weights file; the one that ships with the package if not given."""
    split: Literal["val", "test"] = "val"
    """Which scenes: val for choosing, test for reporting."""
    threads: int | None = None
    """CPU threads."""
    out: Path | None = None
    """Folder for report.json."""

    def run(self) -> None:
        """Evaluates, and prints a table with a column for each kind of scene.

        Raises:
            IcgnetError: unusable weights, or no such scenes.
        """
        from icgnet.files import write_json
        from icgnet.predictor import DEFAULT_WEIGHTS
        from icgnet.training.validation import evaluate_weights

        weights = self.weights or DEFAULT_WEIGHTS
        metrics = evaluate_weights(weights, self.data, self.objects, self.split, self.threads)
        table = Table("metric", *metrics, title=f"split {self.split}")
        for name in dict.fromkeys(name for column in metrics.values() for name in column):
            table.add_row(name, *(f"{column[name]:.4g}" if name in column else "-" for column in metrics.values()))
        Console().print(table)
        if self.out is not None:
            write_json(self.out / "report.json", metrics)

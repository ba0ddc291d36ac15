"""`icgnet evaluate`: how good weights are on generated scenes of held-out objects."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from icgnet.cli.tables import print_table


@dataclass(frozen=True)
class Evaluate:
    """Print the metrics of weights on generated scenes: grasps, shapes, instances and classes."""

    data: tuple[Path, ...]
    """Folders that `icgnet generate` wrote, with objects that the weights were not trained on; they name the hand."""
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
        from icgnet.benchmark.tables import NOTHING, Table
        from icgnet.files import write_json
        from icgnet.predictor import DEFAULT_WEIGHTS
        from icgnet.training.validation import evaluate_weights

        weights = self.weights or DEFAULT_WEIGHTS
        metrics = evaluate_weights(weights, self.data, self.objects, self.split, self.threads)
        names = dict.fromkeys(name for column in metrics.values() for name in column)
        rows = [
            (name, *(f"{column[name]:.4g}" if name in column else NOTHING for column in metrics.values()))
            for name in names
        ]
        print_table(Table(("metric", *metrics), rows, title=f"split {self.split}"))
        if self.out is not None:
            write_json(self.out / "report.json", metrics)

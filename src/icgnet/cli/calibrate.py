"""`icgnet calibrate`: weights whose scores are shares of success."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from icgnet.errors import DataError

if TYPE_CHECKING:
    from icgnet.training.calibration import CalibrationResult, ScoreReport


@dataclass(frozen=True)
class Calibrate:
    """Make a score of 0.9 mean nine successes in ten: fit the scores to validation scenes and write new weights."""

    weights: Path
    """Weights file that `icgnet train` wrote."""
    data: tuple[Path, ...]
    """Folders that `icgnet generate` wrote; their scenes of split val are used, and they name the hand."""
    out: Path
    """Folder for the new weights.safetensors, the reliability diagram (reliability.png) and report.json."""
    objects: tuple[str, ...] = ("procedural",)
    """The object sets that the scenes were made of."""
    scenes: int | None = None
    """At most so many scenes; all of them if not given."""
    threads: int | None = None
    """CPU threads."""

    def run(self) -> None:
        """Calibrates, and prints what the scores were worth before and after.

        Raises:
            IcgnetError: unusable weights, no such scenes, or scores that nothing can be learnt from.
        """
        for path in (self.weights, *self.data):
            if not path.exists():
                raise DataError(f"no such file or folder: {path}")
        from icgnet.files import write_json
        from icgnet.training.calibration import calibrate_weights

        console = Console()

        def say(line: str) -> None:
            console.print(line, markup=False, highlight=False, soft_wrap=True)

        written = self.out / "weights.safetensors"
        result = calibrate_weights(
            self.weights, self.data, self.objects, written, self.scenes, self.threads, report=say
        )
        console.print(_table(result))
        line = result.calibration
        say(f"{written}: logits times {line.scale:.3f} plus {line.offset:+.3f}, fitted on all scenes")
        _draw(result, self.out / "reliability.png")
        write_json(self.out / "report.json", _record(result))


_ROWS = {
    "ece": "expected calibration error",
    "ece_equal_width": "the same, bins of equal width",
    "ece_good": "the same, grasps with a score of 0.5 or more",
    "log_loss": "log loss",
    "best_score": "best seen grasp of a scene: mean score",
    "best_success": "best seen grasp of a scene: share of successes",
}


def _table(result: "CalibrationResult") -> Table:
    title = f"{result.before.grasps} grasps in {result.before.scenes} scenes that the map was not fitted on"
    table = Table("scores", "before", "after", title=title)
    for name, text in _ROWS.items():
        values = (getattr(each, name) for each in (result.before, result.after))
        table.add_row(text, *("-" if value is None else f"{value:.4f}" for value in values))
    for name, report in result.by_hand.items():
        table.add_row(f"{_ROWS['ece']}, {name} ({report.scenes} scenes)", "", f"{report.ece:.4f}")
    return table


def _draw(result: "CalibrationResult", path: Path) -> None:
    from icgnet.viewer.reliability_diagram import ReliabilityPanel, draw_reliability

    def panel(name: str, report: "ScoreReport") -> ReliabilityPanel:
        caption, bins = f"{name}: expected calibration error {report.ece:.3f}", report.diagram
        return ReliabilityPanel(caption, bins.scores, bins.shares, bins.counts, report.best_score, report.best_success)

    draw_reliability([panel("before", result.before), panel("after", result.after)], path)


def _record(result: "CalibrationResult") -> dict[str, object]:
    def numbers(report: "ScoreReport") -> dict[str, object]:
        values: dict[str, object] = {name: getattr(report, name) for name in ("scenes", "grasps", *_ROWS)}
        bins = zip(report.diagram.scores, report.diagram.shares, report.diagram.counts, strict=True)
        used = [{"score": float(score), "share": float(share), "count": int(n)} for score, share, n in bins if n]
        return values | {"bins_of_equal_width": used}

    halves = {"before": numbers(result.before), "after": numbers(result.after)}
    by_hand = {name: numbers(report) for name, report in result.by_hand.items()}
    return {"calibration": asdict(result.calibration), **halves, "after_by_hand": by_hand}

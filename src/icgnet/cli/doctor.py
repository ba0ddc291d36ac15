"""`icgnet doctor`: what is installed, and whether it works."""

import platform
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from icgnet import __version__
from icgnet.cli.demo import FOLDER
from icgnet.errors import DataError
from icgnet.settings import check_range

if TYPE_CHECKING:
    from icgnet.doctor.finding import Finding


@dataclass(frozen=True)
class Doctor:
    """Tell what is installed, what is missing, and whether a prediction works, and how fast.

    Ends with exit code 2 and one line if something is broken. A missing extra is not broken.
    """

    weights: Path | None = None
    """Weights file; the one that ships with the package if not given."""
    threads: int | None = None
    """CPU threads."""
    predict: bool = True
    """Whether the bundled capture is predicted, which takes seconds."""
    repeat: int = 3
    """The median of so many predictions is told."""

    def run(self) -> None:
        """Looks at everything and tells it.

        Raises:
            DataError: something is broken.
        """
        check_range(self, 1.0, "threads", most=256.0)
        check_range(self, 1.0, "repeat", most=100.0)
        console = Console()
        broken = []
        for finding in self._findings():
            mark = "BROKEN  " if finding.is_broken else ""
            console.print(f"{finding.name:15} {mark}{finding.value}", soft_wrap=True, markup=False, highlight=False)
            if finding.hint:
                console.print(f"{'':15} -> {finding.hint}", soft_wrap=True, markup=False, highlight=False)
            if finding.is_broken:
                broken.append(finding.name)
        if broken:
            raise DataError(f"this installation is broken: {', '.join(broken)}")
        console.print("nothing is broken")

    def _findings(self) -> "list[Finding]":
        from icgnet.doctor.finding import Finding
        from icgnet.doctor.packages import package_findings
        from icgnet.doctor.works import prediction_finding, processor_findings, weights_finding

        system = f"{platform.system()} {platform.machine()}"
        found = [
            Finding("icgnet", f"{__version__} in {FOLDER.parent}"),
            Finding("python", f"{platform.python_version()}, {system}"),
            *package_findings(),
            *processor_findings(),
            weights_finding(self.weights),
        ]
        if self.predict and not any(each.is_broken for each in found):
            found.append(prediction_finding(FOLDER / "demo.npz", self.weights, self.threads, self.repeat))
        return found

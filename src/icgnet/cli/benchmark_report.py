"""`icgnet benchmark report`: the numbers of several benchmarks beside the published ones."""

from dataclasses import dataclass
from pathlib import Path

import tyro


@dataclass(frozen=True)
class Report:
    """Put the results of several benchmarks beside the published ones, as Markdown."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Folders with a report.json, or folders that hold such folders."""
    out: Path | None = None
    """File for the Markdown; printed if not given."""

    def run(self) -> None:
        """Reads the reports, and prints or writes the tables.

        Raises:
            IcgnetError: no report there, one that cannot be read or that no benchmark of ours wrote.
        """
        from icgnet.benchmark.comparison import compare
        from icgnet.benchmark.reports import find_reports
        from icgnet.files import new_file

        reports = find_reports(self.folders)
        text = compare(reports)
        if self.out is None:
            print(text, end="")
            return
        self.out.parent.mkdir(parents=True, exist_ok=True)
        with new_file(self.out) as file:
            file.write(text.encode())
        print(f"{self.out}: {len(reports)} {'report' if len(reports) == 1 else 'reports'}")

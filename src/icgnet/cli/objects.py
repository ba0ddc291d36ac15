"""`icgnet objects check`: what is wrong with the files of an object set."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console
from rich.table import Table

from icgnet.cli.notices import print_notice
from icgnet.errors import DataError
from icgnet.objects.kinds import Units


@dataclass(frozen=True)
class CheckObjects:
    """Check a folder of URDFs or meshes: what is wrong with which file."""

    directory: tyro.conf.Positional[Path]
    """Folder of URDFs (VGN layout) or meshes."""
    units: Units | None = None
    """Units of a folder of meshes whose objects.yaml does not name them."""

    def run(self) -> None:
        """Prints a row for every file that is not in order, and how many are.

        Raises:
            DataError: some objects cannot be used.
        """
        from icgnet.objects.check import check_objects, missing_units

        reports = check_objects(self.directory, self.units)
        console = Console()
        table = Table("object", "status", "problems")
        for report in reports:
            if report.status != "ok":
                table.add_row(report.name, report.status, "; ".join(report.problems))
        if table.row_count:
            console.print(table)
        counts = Counter(report.status for report in reports)
        console.print(f"{len(reports)} objects: {counts['ok']} ok, {counts['warning']} doubtful")
        if missing_units(self.directory):
            print_notice(f'before generating, write "units: {self.units}" into {self.directory / "objects.yaml"}')
        if counts["broken"]:
            raise DataError(f"{counts['broken']} of {len(reports)} objects in {self.directory} cannot be used")

"""What the commands share that measure something: they print its tables and write its report."""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import tyro
from rich.console import Console

from icgnet.cli.notices import load_objects
from icgnet.cli.tables import print_table

Flat = tyro.conf.arg(name="")
"""The fields of a configuration are arguments of the command itself."""


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """A command whose module has `measure(config)` and `tables(numbers)`; it is imported when the command runs."""

    config: Any
    """What decides the numbers."""
    out: Path | None = None
    """Folder for report.json."""

    kind: ClassVar[str]
    module: ClassVar[str]

    def run(self) -> None:
        """Measures, prints tables and writes the report.

        Raises:
            IcgnetError: unusable input.
        """
        measured = import_module(self.module)
        for source in self.object_sources():
            load_objects(source)  # says what is left out
        numbers = self.measure(measured)
        if numbers is None:  # of several processes, another one reports
            return
        if hasattr(self.config, "describe"):
            Console().print(f"{self.kind}: {self.config.describe()}", soft_wrap=True, markup=False, highlight=False)
        for table in measured.tables(numbers):
            print_table(table)
        from icgnet.benchmark.record import write_report

        write_report(self.out, self.kind, self.config, numbers)

    def measure(self, module: ModuleType) -> Any:
        """The numbers; None of a process that does not report."""
        return module.measure(self.config)

    def object_sources(self) -> tuple[str | Path, ...]:
        """The object sets that are measured with."""
        objects = self.config.objects
        return objects if isinstance(objects, tuple) else (objects,)

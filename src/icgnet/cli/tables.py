"""Tables of the benchmarks and studies on the terminal."""

from typing import TYPE_CHECKING

from rich import table as rich_table
from rich.console import Console

if TYPE_CHECKING:
    from icgnet.benchmark.tables import Table


def print_table(table: "Table") -> None:
    """Prints a table, and the lines below it."""
    console = Console()
    if table.title:
        console.print(table.title, soft_wrap=True, markup=False, highlight=False)
    printed = rich_table.Table(*table.headers)
    for row in table.rows:
        printed.add_row(*row)
    if table.rows:
        console.print(printed, markup=False)
    for note in table.notes:
        console.print(note, soft_wrap=True, markup=False, highlight=False)

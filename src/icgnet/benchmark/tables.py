"""Tables of numbers: the same rows go to the terminal and into the report in Markdown."""

from collections.abc import Sequence
from dataclasses import dataclass

NOTHING = "-"
"""Stands where there is no number."""


@dataclass(frozen=True)
class Table:
    """Rows of texts.

    Attributes:
        headers: one for each column.
        rows: as many cells each.
        title: said above.
        notes: lines below.
    """

    headers: Sequence[str]
    rows: Sequence[Sequence[str]]
    title: str = ""
    notes: Sequence[str] = ()

    def markdown(self) -> str:
        """Headers and rows in Markdown."""
        lines = [self.headers, ["---"] * len(self.headers), *self.rows]
        return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)

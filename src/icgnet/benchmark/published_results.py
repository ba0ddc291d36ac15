"""What papers print about methods on scenes like ours; published.yaml holds it and names the sources."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

_FILE = yaml.safe_load((Path(__file__).parent / "published.yaml").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class PublishedRates:
    """Grasp success rate and declutter rate of one method [percent], as printed.

    Attributes:
        method: name of it.
        packed_gsr: on packed scenes.
        packed_dr: on packed scenes.
        pile_gsr: on piles.
        pile_dr: on piles.
        measured_by: who ran the method.
        protocol: its rules, cameras and noise, where they are not those of its table.
    """

    method: str
    packed_gsr: str
    packed_dr: str
    pile_gsr: str
    pile_dr: str
    measured_by: str
    protocol: str | None = None


@dataclass(frozen=True)
class PublishedTable:
    """Rates that one source measured in one way.

    Attributes:
        source: paper and table.
        view: ours that comes nearest.
        noise: ours that comes nearest.
        protocol: its rules, cameras and noise.
        scenes: objects and rounds.
        rows: the methods.
    """

    source: str
    view: str
    noise: str
    protocol: str
    scenes: str
    rows: tuple[PublishedRates, ...]


def _table(entry: dict[str, Any]) -> PublishedTable:
    return PublishedTable(**{**entry, "rows": tuple(PublishedRates(*row) for row in entry["rows"])})


RATES: tuple[PublishedTable, ...] = tuple(map(_table, _FILE["rates"]))
"""Clutter removal, the tables of each view and noise in the order in which they are shown."""
SHAPES: tuple[tuple[str, ...], ...] = tuple(map(tuple, _FILE["shapes"]))
"""Reconstruction: method, protocol, scenes, packed IoU and Chamfer-L1, pile IoU and Chamfer-L1, who measured."""
TIMES: tuple[tuple[str, ...], ...] = tuple(map(tuple, _FILE["times"]))
"""Time of one prediction: method, milliseconds, hardware, who measured, parameters of the network."""
CAPTURES: tuple[tuple[str, ...], ...] = tuple(map(tuple, _FILE["captures"]))
"""Objects in real pictures: method, overlap P, R and F, boundary F, share of objects with F >= 0.75, who measured."""

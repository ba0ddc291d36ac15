"""What the command line warns of: on standard error, beside the results."""

from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

if TYPE_CHECKING:
    from icgnet.objects.object_set import ObjectSet


def print_notice(notice: str) -> None:
    """Prints a line of warning."""
    Console(stderr=True).print(f"warning: {notice}", soft_wrap=True, markup=False, highlight=False)


def load_objects(source: str | Path) -> "ObjectSet":
    """The object set that a command was given, after a line on each of its objects that cannot be used.

    Raises:
        IcgnetError: no such set, or a broken one.
    """
    from icgnet.objects.object_set import load_object_set

    object_set = load_object_set(source)
    for notice in object_set.notices():
        print_notice(notice)
    return object_set

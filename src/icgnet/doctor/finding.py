"""One line of what was found."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        name: of the thing.
        value: what was found.
        is_broken: whether icgnet does not work with it.
        hint: what to do about it; empty for nothing.
    """

    name: str
    value: str
    is_broken: bool = False
    hint: str = ""

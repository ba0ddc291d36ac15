"""How the objects of a set are divided, by the kind of scenes that they are for and by what they may be used for."""

from typing import Literal

Kind = Literal["packed", "pile", "table", "bin"]
Split = Literal["train", "val", "test"]
Units = Literal["m", "mm"]
"""Of the coordinates in mesh files."""

CUBE_KINDS: tuple[Kind, ...] = ("packed", "pile")
"""Of the published benchmark: everything stands in the workspace cube."""
WIDE_KINDS: tuple[Kind, ...] = ("table", "bin")
"""Whole tables and bins, with things around them that are no objects."""
KINDS: tuple[Kind, ...] = CUBE_KINDS + WIDE_KINDS
SPLITS: tuple[Split, ...] = ("train", "val", "test")

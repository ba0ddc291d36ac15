"""How the objects of a set are divided, by the kind of scenes that they are for and by what they may be used for."""

from typing import Literal

Kind = Literal["packed", "pile"]
Split = Literal["train", "val", "test"]
Units = Literal["m", "mm"]
"""Of the coordinates in mesh files."""

KINDS: tuple[Kind, ...] = ("packed", "pile")
SPLITS: tuple[Split, ...] = ("train", "val", "test")

"""How the objects of a set are divided: by the kind of scenes that they are for, and by what they may be used for."""

from typing import Literal

Kind = Literal["packed", "pile"]
Split = Literal["train", "val", "test"]

KINDS: tuple[Kind, ...] = ("packed", "pile")
SPLITS: tuple[Split, ...] = ("train", "val", "test")

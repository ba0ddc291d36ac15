"""What every object set can do: list names by scene kind and split, load models and distance grids."""

import os
from abc import ABC, abstractmethod
from collections import Counter, OrderedDict
from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np
from jaxtyping import Float

from icgnet.errors import DataError, InputError
from icgnet.geometry.signed_distance import SignedDistanceGrid
from icgnet.objects.fingerprint import hash_files
from icgnet.objects.kinds import CUBE_KINDS, KINDS, SPLITS, Kind, Split, Units
from icgnet.objects.model import ObjectModel

_GRIDS_IN_MEMORY = 512


def cache_directory() -> Path:
    """Returns the folder for derived data: `$ICGNET_CACHE`, or `~/.cache/icgnet`."""
    return Path(os.environ.get("ICGNET_CACHE") or Path.home() / ".cache" / "icgnet")


class UnusableObjectError(DataError):
    """An object cannot be loaded, or the physics engine cannot make a body of it.

    Attributes:
        name: key of the object.
        reason: what was wrong with it.
    """

    def __init__(self, name: str, reason: str) -> None:
        super().__init__(name, reason)
        self.name = name
        self.reason = reason

    def __str__(self) -> str:
        return f"object {self.name!r} cannot be used: {self.reason}"


class ObjectSet(ABC):
    """Named objects by scene kind and split; models and distance grids are loaded when asked for, and kept.

    Attributes:
        name: of the set.
        left_out: keys that the set has files for but that are not used, each with the reason.
    """

    def __init__(self, name: str, left_out: Mapping[str, str] | None = None) -> None:
        self.name = name
        self.left_out: dict[str, str] = dict(left_out or {})
        self._models: dict[str, ObjectModel] = {}
        self._grids: OrderedDict[str, SignedDistanceGrid] = OrderedDict()

    @abstractmethod
    def names(self, kind: Kind, split: Split) -> tuple[str, ...]:
        """Returns the sorted keys of the objects for scenes of `kind` in `split`.

        Raises:
            InputError: unknown kind or split.
        """

    @abstractmethod
    def class_name(self, key: str) -> str:
        """Returns an object's class without loading it.

        Raises:
            InputError: there is no such object.
        """

    def class_alternative(self, key: str) -> str | None:
        """Returns the class that an object could have had as well, None where its class is clear or nothing is known.

        Raises:
            InputError: there is no such object.
        """
        self.class_name(key)
        return None

    def group(self, key: str) -> str:
        """Returns what an object is one of several of, its folder: see `draw_weights`."""
        return key.rpartition("/")[0]

    def draw_weights(self, kind: Kind, split: Split) -> Float[np.ndarray, "n"]:
        """Returns how often each of `names(kind, split)` is drawn, adding up to 1.

        In packed and pile scenes all objects are alike. In wide scenes a group of objects is drawn as often as the
        square root of their number says, so that hundreds of random bodies do not drown a shelf of groceries.

        Raises:
            InputError: unknown kind or split.
        """
        names = self.names(kind, split)
        if kind in CUBE_KINDS:
            return np.full(len(names), 1.0 / max(len(names), 1))
        groups = [self.group(name) for name in names]
        sizes = Counter(groups)
        weights = np.array([sizes[group] ** -0.5 for group in groups], np.float64)
        return weights / weights.sum()

    def without(self, left_out: Mapping[str, str]) -> "ObjectSet":
        """Returns the set without some of its objects; `left_out` gives the reason for each.

        Raises:
            DataError: the set makes its objects itself, so that something is wrong with the program.
        """
        key, reason = next(iter(left_out.items()))
        raise DataError(f"object {key!r} of {self.name!r} cannot be used: {reason}")

    @abstractmethod
    def fingerprint(self, key: str) -> str:
        """Returns a short hash that is another one when the object's class or geometry may have changed.

        It is made without loading the object.

        Raises:
            InputError: there is no such object.
        """

    @abstractmethod
    def _load(self, key: str) -> ObjectModel:
        """Returns the model of a key that exists."""

    def keys(self) -> tuple[str, ...]:
        """Returns all keys, sorted."""
        return tuple(sorted({key for kind in KINDS for split in SPLITS for key in self.names(kind, split)}))

    def model(self, key: str) -> ObjectModel:
        """Returns an object's meshes at scale 1.

        Raises:
            InputError: there is no such object.
            UnusableObjectError: its files are broken, or something that is made of them fails.
        """
        if key not in self._models:
            self.class_name(key)
            try:
                self._models[key] = self._load(key)
            except UnusableObjectError as error:
                raise UnusableObjectError(key, error.reason) from error
            except Exception as error:  # libraries for meshes fail in many ways on a strange one
                raise UnusableObjectError(key, " ".join(str(error).split()) or type(error).__name__) from error
        return self._models[key]

    def signed_distance(self, key: str) -> SignedDistanceGrid:
        """Returns an object's signed-distance grid at scale 1, built once and then read from the cache folder."""
        if key not in self._grids:
            self._grids[key] = self.model(key).signed_distance(cache_directory() / "signed_distance")
            if len(self._grids) > _GRIDS_IN_MEMORY:
                self._grids.popitem(last=False)
        self._grids.move_to_end(key)
        return self._grids[key]

    def notices(self) -> list[str]:
        """Returns a line on each object that is left out."""
        return [f"{key} is left out: {reason}" for key, reason in self.left_out.items()]

    def __getstate__(self) -> dict[str, object]:
        """Leaves what was loaded behind: a worker process reads what it needs itself."""
        return self.__dict__ | {"_models": {}, "_grids": OrderedDict()}


Scale = tuple[float, float, float]
"""Factors along x, y and z."""
UNSCALED: Scale = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class ObjectFile:
    """An object of a set that is read from files; `scale` is applied to meshes on top of their units."""

    path: Path
    class_name: str
    kinds: tuple[Kind, ...]
    split: Split
    class_alternative: str | None = None
    scale: Scale = UNSCALED


class FileObjectSet(ObjectSet):
    """An object set whose objects are listed beforehand, each with its file.

    Attributes:
        units: of mesh files ("m" or "mm"); None for URDFs, which say their own scale.

    Args:
        name: of the set.
        files: the objects.
        left_out: objects that are not used, each with the reason.
        units: see above.
        settings: what else than their files decides the geometry of the objects.
    """

    def __init__(
        self,
        name: str,
        files: dict[str, ObjectFile],
        left_out: Mapping[str, str] | None = None,
        units: Units | None = None,
        settings: str = "",
    ) -> None:
        super().__init__(name, left_out)
        self.units: Units | None = units
        self._files = files
        self._settings = settings

    def names(self, kind: Kind, split: Split) -> tuple[str, ...]:
        """Returns the sorted keys of the objects for scenes of `kind` in `split`."""
        check_kind_and_split(kind, split)
        return tuple(sorted(key for key, file in self._files.items() if kind in file.kinds and file.split == split))

    def class_name(self, key: str) -> str:
        """Returns an object's class without loading it."""
        return self.file(key).class_name

    def class_alternative(self, key: str) -> str | None:
        """Returns the class that an object could have had as well, None where its class is clear."""
        return self.file(key).class_alternative

    def file(self, key: str) -> ObjectFile:
        """Returns where an object comes from.

        Raises:
            InputError: there is no such object.
        """
        if key in self.left_out:
            raise InputError(f"object set {self.name!r}: {key!r} is left out: {self.left_out[key]}")
        if key not in self._files:
            raise unknown_object(self.name, key, self._files)
        return self._files[key]

    def fingerprint(self, key: str) -> str:
        """Returns a short hash of the object's class and files."""
        file = self.file(key)
        settings = self._settings if file.scale == UNSCALED else f"{self._settings}, {file.scale}"
        return hash_files(file.path, (file.class_name, settings))

    def without(self, left_out: Mapping[str, str]) -> "FileObjectSet":
        """Returns the set without some of its objects; `left_out` gives the reason for each."""
        rest = copy(self)
        rest._files = {key: file for key, file in self._files.items() if key not in left_out}
        rest.left_out = dict(sorted({**self.left_out, **left_out}.items()))
        return rest


def doubles(copies: Mapping[str, int]) -> dict[str, str]:
    """Returns the names that more than one object has, with the sentence that says so."""
    return {name: f"{count} objects have this name" for name, count in sorted(copies.items()) if count > 1}


def check_kind_and_split(kind: str, split: str) -> None:
    """Raises InputError unless both are known."""
    if kind not in KINDS:
        raise InputError(f"unknown scene kind {kind!r}; the kinds are {', '.join(KINDS)}")
    if split not in SPLITS:
        raise InputError(f"unknown split {split!r}; the splits are {', '.join(SPLITS)}")


def unknown_object(set_name: str, key: str, known: Iterable[str]) -> InputError:
    """Returns the error for a key that a set does not have, with the keys most like it."""
    similar = get_close_matches(key, list(known), n=3)
    hint = f"; did you mean {' or '.join(similar)}?" if similar else ""
    return InputError(f"object set {set_name!r} has no object {key!r}{hint}")

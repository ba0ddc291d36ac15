"""Object sets: where scenes get their objects from."""

import os
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Literal

from icgnet.errors import DataError, InputError
from icgnet.geometry.signed_distance import SignedDistanceGrid
from icgnet.objects.classes import VGN_CLASSES, VGN_VAL, read_classes
from icgnet.objects.model import ObjectModel
from icgnet.objects.urdf import read_urdf_object

Kind = Literal["packed", "pile"]
Split = Literal["train", "val", "test"]

KINDS: tuple[Kind, ...] = ("packed", "pile")
SPLITS: tuple[Split, ...] = ("train", "val", "test")

_GRIDS_IN_MEMORY = 512


def cache_directory() -> Path:
    """Returns the folder for derived data: `$ICGNET_CACHE`, or `~/.cache/icgnet`."""
    return Path(os.environ.get("ICGNET_CACHE") or Path.home() / ".cache" / "icgnet")


class ObjectSet(ABC):
    """Named objects by scene kind and split; models and distance grids are loaded when asked for, and kept."""

    def __init__(self, name: str) -> None:
        self.name = name
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
            DataError: its files are broken.
        """
        if key not in self._models:
            self.class_name(key)
            self._models[key] = self._load(key)
        return self._models[key]

    def signed_distance(self, key: str) -> SignedDistanceGrid:
        """Returns an object's signed-distance grid at scale 1, built once and then read from the cache folder."""
        if key not in self._grids:
            self._grids[key] = self.model(key).signed_distance(cache_directory() / "signed_distance")
            if len(self._grids) > _GRIDS_IN_MEMORY:
                self._grids.popitem(last=False)
        self._grids.move_to_end(key)
        return self._grids[key]

    def __getstate__(self) -> dict[str, object]:
        """Leaves what was loaded behind: a worker process reads what it needs itself."""
        return self.__dict__ | {"_models": {}, "_grids": OrderedDict()}


@dataclass(frozen=True)
class ObjectFile:
    """An object of a set that is read from files."""

    path: Path
    class_name: str
    kinds: tuple[Kind, ...]
    split: Split


class FileObjectSet(ObjectSet):
    """An object set whose objects are listed beforehand, each with its file."""

    def __init__(self, name: str, files: dict[str, ObjectFile]) -> None:
        super().__init__(name)
        self._files = files

    def names(self, kind: Kind, split: Split) -> tuple[str, ...]:
        check_kind_and_split(kind, split)
        return tuple(sorted(key for key, file in self._files.items() if kind in file.kinds and file.split == split))

    def class_name(self, key: str) -> str:
        return self.file(key).class_name

    def file(self, key: str) -> ObjectFile:
        """Returns where an object comes from.

        Raises:
            InputError: there is no such object.
        """
        if key not in self._files:
            raise unknown_object(self.name, key, self._files)
        return self._files[key]


class UrdfObjectSet(FileObjectSet):
    """Objects in the VGN layout: `packed/{train,test}/*.urdf` and `pile/{train,test}/*.urdf`, keys "pile/name".

    Classes come from `classes.json` in the folder and held-out names from `val.txt`; for the VGN objects
    themselves both ship with this package. Objects without a class are "other".
    """

    def __init__(self, directory: Path) -> None:
        paths = sorted(path for kind in KINDS for split in ("train", "test") for path in directory.glob(f"{kind}/{split}/*.urdf"))
        if not paths:
            raise DataError(f"{directory}: no packed/{{train,test}}/*.urdf or pile/{{train,test}}/*.urdf found")
        names = {path.stem for path in paths}
        vgn_classes = read_classes(VGN_CLASSES)
        is_vgn = names <= vgn_classes.keys()
        classes_file, val_file = directory / "classes.json", directory / "val.txt"
        classes = read_classes(classes_file) if classes_file.is_file() else vgn_classes if is_vgn else {}
        val_file = VGN_VAL if is_vgn and not val_file.is_file() else val_file
        held_out = set(val_file.read_text().split()) if val_file.is_file() else set()

        files: dict[str, ObjectFile] = {}
        for path in paths:
            kind: Kind = "packed" if path.parent.parent.name == "packed" else "pile"
            split: Split = "test" if path.parent.name == "test" else "val" if path.stem in held_out else "train"
            key = f"{kind}/{path.stem}"
            if key in files:
                raise DataError(f"{directory}: {key} is in train and in test")
            files[key] = ObjectFile(path, classes.get(path.stem, "other"), (kind,), split)
        super().__init__("vgn" if is_vgn else directory.resolve().name, files)

    def _load(self, key: str) -> ObjectModel:
        file = self.file(key)
        return read_urdf_object(file.path, key, file.class_name)


def load_object_set(source: str | Path, units: Literal["m", "mm"] | None = None) -> ObjectSet:
    """Returns the object set that `source` names.

    Args:
        source: "procedural" (the embedded set), a folder in the VGN layout (`packed/`, `pile/` with URDFs), or a
            folder of OBJ, PLY, STL or GLB meshes.
        units: units of a folder of meshes, if its `objects.yaml` does not say them.

    Raises:
        InputError: there is no such folder or set.
        DataError: the folder holds no objects, or its lists are broken.
    """
    if str(source) == "procedural":
        from icgnet.objects.procedural import ProceduralObjectSet

        return ProceduralObjectSet()
    directory = Path(source).expanduser()
    if not directory.is_dir():
        raise InputError(f'no object set {str(source)!r}: give "procedural" or an existing folder of URDFs or meshes')
    if any((directory / kind).is_dir() for kind in KINDS):
        return UrdfObjectSet(directory)
    from icgnet.objects.mesh_folder import MeshFolderObjectSet

    return MeshFolderObjectSet(directory, units)


def warm_cache(object_set: ObjectSet, workers: int = 1, keys: Sequence[str] | None = None) -> int:
    """Builds the signed-distance grids of all objects (or of `keys`) in the cache folder; returns their number."""
    keys = object_set.keys() if keys is None else keys
    if workers == 1:
        for key in keys:
            object_set.signed_distance(key)
        return len(keys)
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        return sum(pool.map(_warm_one, [object_set] * len(keys), keys, chunksize=8))


def _warm_one(object_set: ObjectSet, key: str) -> int:
    object_set.signed_distance(key)
    return 1


def check_kind_and_split(kind: str, split: str) -> None:
    """Raises InputError unless both are known."""
    if kind not in KINDS:
        raise InputError(f"unknown scene kind {kind!r}; the kinds are {', '.join(KINDS)}")
    if split not in SPLITS:
        raise InputError(f"unknown split {split!r}; the splits are {', '.join(SPLITS)}")


def unknown_object(set_name: str, key: str, known: Sequence[str] | dict[str, ObjectFile]) -> InputError:
    """Returns the error for a key that a set does not have, with the keys most like it."""
    from difflib import get_close_matches

    similar = get_close_matches(key, list(known), n=3)
    hint = f"; did you mean {' or '.join(similar)}?" if similar else ""
    return InputError(f"object set {set_name!r} has no object {key!r}{hint}")

"""A folder of meshes (or of single URDFs) as an object set."""

import hashlib
import reprlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh
import yaml
from jaxtyping import Float

from icgnet.errors import DataError
from icgnet.objects.base import FileObjectSet, ObjectFile, cache_directory, doubles
from icgnet.objects.classes import check_classes
from icgnet.objects.decomposition import decompose, decomposition_method, decomposition_notices
from icgnet.objects.kinds import KINDS, Split, Units
from icgnet.objects.model import ObjectModel, clean_surface
from icgnet.objects.urdf import read_mesh, read_urdf_object

MESH_SUFFIXES = (".obj", ".ply", ".stl", ".glb")
LIST_FILE = "objects.yaml"

_METRES = {"m": 1.0, "mm": 0.001}


@dataclass(frozen=True)
class FolderList:
    """What `objects.yaml` says about a folder of meshes; every entry may be missing.

    Attributes:
        units: units of the vertices.
        classes: object name -> class.
        splits: object name -> "val" or "test".
    """

    units: Units | None = None
    classes: dict[str, str] = field(default_factory=dict)
    splits: dict[str, Split] = field(default_factory=dict)


class MeshFolderObjectSet(FileObjectSet):
    """Every OBJ, PLY, STL and GLB file of a folder, or every URDF if there are any; keys are the files' stems.

    All objects serve both scene kinds. Splits are those of `objects.yaml`; without them a name's hash puts about
    one tenth of the objects each in "val" and "test", the same ones whatever else is in the folder. Files of one stem
    are all left out, for nobody knows which is meant.

    Args:
        directory: folder of the files.
        units: of the meshes, if `objects.yaml` does not say.

    Raises:
        DataError: no objects, a broken `objects.yaml`, or units that nobody gave.
    """

    def __init__(self, directory: Path, units: Units | None = None) -> None:
        paths = object_paths(directory)
        if not paths:
            raise DataError(f"{directory}: no objects found (looked for *.urdf and *{', *'.join(MESH_SUFFIXES)})")
        listed = read_folder_list(directory)
        given = listed.units or units
        if given is None and paths[0].suffix.lower() != ".urdf":
            raise DataError(
                f'{directory}: in which units are the meshes? Write "units: m" or "units: mm" in {LIST_FILE}'
            )
        copies = Counter(path.stem for path in paths)
        files: dict[str, ObjectFile] = {}
        for path in paths:
            if copies[path.stem] > 1:
                continue
            split = listed.splits.get(path.stem, "train") if listed.splits else _split_by_name(path.stem)
            files[path.stem] = ObjectFile(path, listed.classes.get(path.stem, "other"), KINDS, split)
        super().__init__(
            directory.resolve().name,
            files,
            left_out=doubles(copies),
            units=given,
            settings=f"{given}, {decomposition_method()}",
        )

    def notices(self) -> list[str]:
        """Returns a line on each object that is left out, and one where the physics sees no hollows."""
        has_meshes = any(file.path.suffix.lower() != ".urdf" for file in self._files.values())
        return super().notices() + (decomposition_notices() if has_meshes else [])

    def _load(self, key: str) -> ObjectModel:
        file = self.file(key)
        if file.path.suffix.lower() == ".urdf":
            return read_urdf_object(file.path, key, file.class_name)
        surface = read_scaled_mesh(file.path, self.units or "m")
        surface.apply_translation(-_centre(surface))
        return ObjectModel(key, file.class_name, surface, decompose(surface, cache_directory() / "convex_parts"))


def object_paths(directory: Path) -> list[Path]:
    """Returns the files that are objects, sorted: the URDFs, or the meshes where there are none."""
    urdfs = sorted(directory.glob("*.urdf"))
    return urdfs or sorted(path for path in directory.iterdir() if path.suffix.lower() in MESH_SUFFIXES)


def read_scaled_mesh(path: Path, units: Units) -> trimesh.Trimesh:
    """Returns a mesh file's cleaned surface [m], z up (GLB files are y up by their format, and are turned).

    Raises:
        DataError: the file cannot be read or has no faces.
    """
    surface = clean_surface(read_mesh(path), str(path))
    T_up_file = np.diag([_METRES[units]] * 3 + [1.0])
    if path.suffix.lower() == ".glb":
        T_up_file = T_up_file @ np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], np.float64)
    return surface.apply_transform(T_up_file)


def read_folder_list(directory: Path) -> FolderList:
    """Returns what `objects.yaml` says, or an empty list where there is none.

    Raises:
        DataError: the file is not YAML, or has unknown entries, units, classes or splits.
    """
    path = directory / LIST_FILE
    if not path.is_file():
        return FolderList()
    try:
        content = yaml.safe_load(path.read_text()) or {}
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise DataError(f"{path}: not readable as YAML: {' '.join(str(error).split())[:300]}") from error
    if not isinstance(content, dict) or content.keys() - {"units", "classes", "splits"}:
        raise DataError(f"{path}: expected the entries units, classes and splits, found {reprlib.repr(content)}")
    units = content.get("units")
    if units not in (None, "m", "mm"):
        raise DataError(f'{path}: units are {units!r}; they can be "m" or "mm"')
    return FolderList(units, check_classes(content.get("classes") or {}, path), _check_splits(content, path))


def _check_splits(content: dict, path: Path) -> dict[str, Split]:
    entry = content.get("splits") or {}
    if not isinstance(entry, dict) or entry.keys() - {"val", "test"}:
        raise DataError(f"{path}: splits are lists of names under val and test, found {reprlib.repr(entry)}")
    splits: dict[str, Split] = {}
    held_out: tuple[Split, Split] = ("val", "test")
    for split in held_out:
        for name in entry.get(split) or []:
            if str(name) in splits:
                raise DataError(f"{path}: {name!r} is in val and in test")
            splits[str(name)] = split
    return splits


def _split_by_name(name: str) -> Split:
    tenth = hashlib.sha256(name.encode()).digest()[0] % 10
    return "val" if tenth == 8 else "test" if tenth == 9 else "train"


def _centre(surface: trimesh.Trimesh) -> Float[np.ndarray, "3"]:
    """Returns the centre of mass, of the convex hull if the mesh is open."""
    return np.array(surface.center_mass if surface.is_watertight else surface.convex_hull.center_mass)

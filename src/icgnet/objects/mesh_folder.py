"""A folder of meshes (or of single URDFs) as an object set."""

import hashlib
import json
import reprlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh
import yaml
from jaxtyping import Float

from icgnet.errors import DataError
from icgnet.objects.base import UNSCALED, FileObjectSet, ObjectFile, Scale, cache_directory, doubles
from icgnet.objects.classes import DATA_DIR, check_classes
from icgnet.objects.decomposition import decompose, decomposition_method, decomposition_notices
from icgnet.objects.kinds import KINDS, Split, Units
from icgnet.objects.model import ObjectModel, check_size, clean_surface
from icgnet.objects.urdf import read_mesh, read_urdf_object

MESH_SUFFIXES = (".obj", ".ply", ".stl", ".glb")
LIST_FILE = "objects.yaml"
SHIPPED_LISTS = {"objects_wide": DATA_DIR / "objects_wide.json"}
"""Of published meshes that are not part of this project, by the name of the object set."""

_METRES = {"m": 1.0, "mm": 0.001}


@dataclass(frozen=True)
class FolderList:
    """What `objects.yaml` says about a folder of meshes; every entry may be missing.

    Attributes:
        units: units of the vertices.
        classes: object name -> class.
        splits: object name -> "val" or "test".
        scales: object or subfolder -> factors along x, y and z, for meshes that are not of their real size.
    """

    units: Units | None = None
    classes: dict[str, str] = field(default_factory=dict)
    splits: dict[str, Split] = field(default_factory=dict)
    scales: dict[str, Scale] = field(default_factory=dict)

    def scale(self, name: str) -> Scale:
        """Returns the factors of an object: its own, or those of its folder."""
        return self.scales.get(name, self.scales.get(name.rpartition("/")[0], UNSCALED))


class MeshFolderObjectSet(FileObjectSet):
    """Every OBJ, PLY, STL and GLB file of a folder and of the folders in it, or every URDF if there are any.

    Keys are the paths within the folder, without their suffix: "cup", "kitchen/cup". All objects serve all kinds of
    scenes. Splits are those of `objects.yaml`; without them a name's hash puts about one tenth of the objects each in
    "val" and "test", the same ones whatever else is in the folder. Files of one key are all left out, for nobody knows
    which is meant.

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
        names = [object_name(path, directory) for path in paths]
        published = published_name(directory, names)
        listed = read_folder_list(directory, published)
        given = listed.units or units
        if given is None and paths[0].suffix.lower() != ".urdf":
            raise DataError(
                f'{directory}: in which units are the meshes? Write "units: m" or "units: mm" in {LIST_FILE}'
            )
        copies = Counter(names)
        files: dict[str, ObjectFile] = {}
        for name, path in zip(names, paths, strict=True):
            if copies[name] > 1:
                continue
            split = listed.splits.get(name, "train") if listed.splits else _split_by_name(name)
            files[name] = ObjectFile(path, listed.classes.get(name, "other"), KINDS, split, scale=listed.scale(name))
        super().__init__(
            published or directory.resolve().name,
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
        surface = read_scaled_mesh(file.path, self.units or "m", file.scale)
        check_size(surface, str(file.path))
        surface.apply_translation(-_centre(surface))
        return ObjectModel(key, file.class_name, surface, decompose(surface, cache_directory() / "convex_parts"))


def object_paths(directory: Path) -> list[Path]:
    """Returns the files that are objects, sorted: the URDFs, or the meshes where there are none; no hidden ones."""
    files = [path for path in sorted(directory.rglob("*")) if not _is_hidden(path.relative_to(directory))]
    urdfs = [path for path in files if path.suffix.lower() == ".urdf"]
    return urdfs or [path for path in files if path.suffix.lower() in MESH_SUFFIXES]


def object_name(path: Path, directory: Path) -> str:
    """Returns the key of an object of a folder: its path there, without the suffix."""
    return path.relative_to(directory).with_suffix("").as_posix()


def published_name(directory: Path, names: Sequence[str]) -> str | None:
    """Returns the name of the published set that a folder holds, or some of, and that a shipped list describes.

    A folder with a list of its own is nobody else's.
    """
    if (directory / LIST_FILE).is_file() or not any("/" in name for name in names):
        return None
    for set_name, path in SHIPPED_LISTS.items():
        if set(names) <= json.loads(path.read_text())["classes"].keys():
            return set_name
    return None


def read_scaled_mesh(path: Path, units: Units, scale: Scale = UNSCALED) -> trimesh.Trimesh:
    """Returns a mesh file's cleaned surface [m], z up (GLB files are y up by their format, and are turned).

    Args:
        path: of the file.
        units: of its coordinates.
        scale: factors along x, y and z of the surface, on top of the units.

    Raises:
        DataError: the file cannot be read or has no faces.
    """
    surface = clean_surface(read_mesh(path), str(path))
    T_up_file = np.diag([_METRES[units]] * 3 + [1.0])
    if path.suffix.lower() == ".glb":
        T_up_file = T_up_file @ np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], np.float64)
    surface.apply_transform(T_up_file)
    return surface if scale == UNSCALED else surface.apply_transform(np.diag([*scale, 1.0]))


def read_folder_list(directory: Path, published: str | None = None) -> FolderList:
    """Returns what `objects.yaml` says, or the shipped list of a published set; an empty list where there is neither.

    Raises:
        DataError: the file is not YAML, or has unknown entries, units, classes, splits or scales.
    """
    if published is not None:
        path = SHIPPED_LISTS[published]
        return _folder_list(json.loads(path.read_text()), path)
    path = directory / LIST_FILE
    if not path.is_file():
        return FolderList()
    try:
        content = yaml.safe_load(path.read_text()) or {}
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise DataError(f"{path}: not readable as YAML: {' '.join(str(error).split())[:300]}") from error
    return _folder_list(content, path)


def _folder_list(content: object, path: Path) -> FolderList:
    entries = {"units", "classes", "splits", "scales"}
    if not isinstance(content, dict) or content.keys() - entries:
        raise DataError(
            f"{path}: expected the entries units, classes, splits and scales, found {reprlib.repr(content)}"
        )
    units = content.get("units")
    if units not in (None, "m", "mm"):
        raise DataError(f'{path}: units are {units!r}; they can be "m" or "mm"')
    classes = check_classes(content.get("classes") or {}, path)
    return FolderList(units, classes, _check_splits(content, path), _check_scales(content, path))


def _check_scales(content: dict, path: Path) -> dict[str, Scale]:
    entry = content.get("scales") or {}
    if not isinstance(entry, dict):
        raise DataError(f"{path}: scales map names of objects or folders to factors, found {reprlib.repr(entry)}")
    scales: dict[str, Scale] = {}
    for name, given in entry.items():
        factors = given if isinstance(given, list) else [given] * 3
        if len(factors) != 3 or not all(isinstance(each, int | float) and 0.0 < each < np.inf for each in factors):
            raise DataError(f"{path}: the scale of {name!r} must be one or three positive numbers, got {given!r}")
        scales[str(name)] = (float(factors[0]), float(factors[1]), float(factors[2]))
    return scales


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


def _is_hidden(path: Path) -> bool:
    return any(part.startswith(".") for part in path.parts)


def _split_by_name(name: str) -> Split:
    tenth = hashlib.sha256(name.encode()).digest()[0] % 10
    return "val" if tenth == 8 else "test" if tenth == 9 else "train"


def _centre(surface: trimesh.Trimesh) -> Float[np.ndarray, "3"]:
    """Returns the centre of mass, of the convex hull if the mesh is open."""
    return np.array(surface.center_mass if surface.is_watertight else surface.convex_hull.center_mass)

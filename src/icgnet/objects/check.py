"""What is wrong with the files of an object set, file by file."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import trimesh

from icgnet.errors import DataError, InputError
from icgnet.objects.mesh_folder import LIST_FILE, Units, object_paths, read_folder_list, read_scaled_mesh
from icgnet.objects.urdf import read_urdf_object
from icgnet.objects.urdf_set import is_vgn_layout, urdf_paths

LARGEST, SMALLEST = 1.0, 0.001
"""A longest side beyond these [m] means other units than were said."""


@dataclass(frozen=True)
class ObjectReport:
    """The verdict on one file: "ok", "warning" (usable, but look at it) or "broken" (cannot be used)."""

    name: str
    status: Literal["ok", "warning", "broken"]
    problems: tuple[str, ...]


def check_objects(directory: str | Path, units: Units | None = None) -> list[ObjectReport]:
    """Returns a report on every object of a folder, in either layout; a broken one does not stop the others.

    Args:
        directory: folder in the VGN layout, or a folder of meshes or URDFs.
        units: of a folder of meshes, if its `objects.yaml` does not say.

    Raises:
        InputError: there is no such folder.
        DataError: it holds no objects at all, or its `objects.yaml` is broken.
    """
    directory = Path(directory).expanduser()
    if not directory.is_dir():
        raise InputError(f"{directory} is not a folder")
    vgn = is_vgn_layout(directory)
    paths = urdf_paths(directory) if vgn else object_paths(directory)
    if not paths:
        raise DataError(f"{directory}: no URDFs or meshes found")
    listed_units = None if vgn else read_folder_list(directory).units
    names = [f"{path.parent.parent.name}/{path.stem}" if vgn else path.stem for path in paths]
    copies = Counter(names)
    return [_report(name, path, listed_units or units, copies[name]) for name, path in zip(names, paths, strict=True)]


def _report(name: str, path: Path, units: Units | None, copies: int) -> ObjectReport:
    broken = [f"{copies} objects have this name"] if copies > 1 else []
    warnings: list[str] = []
    try:
        surface = _read_surface(path, units)
    except DataError as error:
        broken.append(str(error))
    else:
        warnings = _doubts(surface)
    status = "broken" if broken else "warning" if warnings else "ok"
    return ObjectReport(name, status, (*broken, *warnings))


def _read_surface(path: Path, units: Units | None) -> trimesh.Trimesh:
    if path.suffix.lower() == ".urdf":
        return read_urdf_object(path, path.stem, "other").visual
    if units is None:
        raise DataError(f'{path}: units unknown; write "units: m" or "units: mm" in {LIST_FILE}')
    return read_scaled_mesh(path, units)


def _doubts(surface: trimesh.Trimesh) -> list[str]:
    doubts = []
    longest = float(surface.extents.max())
    if not SMALLEST <= longest <= LARGEST:
        doubts.append(f"the longest side is {longest:.4g} m: are the units right?")
    if not surface.is_watertight:
        doubts.append("the mesh is open: inside and outside are guessed by majority")
    return doubts

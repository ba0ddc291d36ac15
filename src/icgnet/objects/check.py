"""What is wrong with the files of an object set, file by file."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import trimesh

from icgnet.errors import DataError, InputError
from icgnet.files import new_file
from icgnet.objects.base import FileObjectSet, ObjectSet, Scale, cache_directory, doubles
from icgnet.objects.fingerprint import hash_texts
from icgnet.objects.kinds import Units
from icgnet.objects.mesh_folder import (
    LIST_FILE,
    FolderList,
    object_name,
    object_paths,
    published_name,
    read_folder_list,
    read_scaled_mesh,
)
from icgnet.objects.mixed_set import SEPARATOR, MixedObjectSet
from icgnet.objects.model import check_size
from icgnet.objects.urdf import read_urdf_object
from icgnet.objects.urdf_set import is_vgn_layout, object_key, urdf_paths

END_SHARE = 0.01
"""Part of an edge at each end where nothing is looked for."""

MERGED = 1e-9
"""Shorter edges [m] count as this long."""

CHECK_VERSION = 4
"""To be raised when a check or a reader changes, so that remembered reports are made anew."""


@dataclass(frozen=True)
class ObjectReport:
    """The verdict on one file.

    Attributes:
        name: of the object.
        status: "ok", "warning" (usable, but look at it) or "broken" (cannot be used).
        problems: what is odd or broken.
        sides: lengths of the box around the object at scale 1 [m]; zeros for a broken one.
    """

    name: str
    status: Literal["ok", "warning", "broken"]
    problems: tuple[str, ...]
    sides: Scale = (0.0, 0.0, 0.0)


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
    names = [object_key(path) if vgn else object_name(path, directory) for path in paths]
    listed = FolderList() if vgn else read_folder_list(directory, published_name(directory, names))
    double = doubles(Counter(names))
    reports = [
        _report(name, path, listed.units or units, listed.scale(name)) for name, path in zip(names, paths, strict=True)
    ]
    return [
        ObjectReport(report.name, "broken", (double[report.name], *report.problems))
        if report.name in double
        else report
        for report in reports
    ]


def missing_units(directory: Path) -> bool:
    """Returns whether a folder of meshes lacks the units that every other command needs, in its `objects.yaml`."""
    if is_vgn_layout(directory):
        return False
    paths = object_paths(directory)
    published = published_name(directory, [object_name(path, directory) for path in paths])
    if read_folder_list(directory, published).units is not None:
        return False
    return any(path.suffix.lower() != ".urdf" for path in paths)


def check_object_set(object_set: ObjectSet, keys: Sequence[str]) -> list[ObjectReport]:
    """Returns a report on each of these objects of a set.

    Reports are remembered in the cache folder until a file changes, because reading several hundred meshes takes some
    seconds. Procedural shapes come without a report: tests hold that they are in order.
    """
    if isinstance(object_set, MixedObjectSet):
        return [
            replace(report, name=f"{member.name}{SEPARATOR}{report.name}")
            for member, own in object_set.split_keys(keys)
            for report in check_object_set(member, own)
        ]
    if not isinstance(object_set, FileObjectSet):
        return []
    files = [(key, object_set.file(key)) for key in keys]
    objects = [(key, file.path, object_set.fingerprint(key)) for key, file in files]
    # The paths too: they are part of what the reports say.
    content = hash_texts(str(CHECK_VERSION), *(f"{key} {path.resolve()} {mark}" for key, path, mark in objects))
    cache = cache_directory() / "object_checks" / f"{content}.json"
    reports = _read_reports(cache)
    if reports is None:
        reports = [_report(key, file.path, object_set.units, file.scale) for key, file in files]
        _write_reports(cache, reports)
    return reports


def _report(name: str, path: Path, units: Units | None, scale: Scale) -> ObjectReport:
    try:
        surface = _read_surface(path, units, scale)
    except DataError as error:
        return ObjectReport(name, "broken", (str(error),))
    doubts = _doubts(surface)
    along_x, along_y, along_z = surface.extents.tolist()
    return ObjectReport(name, "warning" if doubts else "ok", tuple(doubts), (along_x, along_y, along_z))


def _read_surface(path: Path, units: Units | None, scale: Scale) -> trimesh.Trimesh:
    if path.suffix.lower() == ".urdf":
        return read_urdf_object(path, path.stem, "other").visual
    if units is None:
        raise DataError(f'{path}: units unknown; write "units: m" or "units: mm" in {LIST_FILE}')
    surface = read_scaled_mesh(path, units, scale)
    check_size(surface, str(path))
    return surface


def _doubts(surface: trimesh.Trimesh) -> list[str]:
    doubts = []
    if not surface.is_watertight:
        doubts.append("the mesh is open: inside and outside are guessed by majority")
    if _crosses_itself(surface):
        doubts.append("the mesh intersects itself: its inside may have holes")
    return doubts


def _crosses_itself(surface: trimesh.Trimesh) -> bool:
    """Returns whether an edge pierces a triangle of its own component that it does not touch at a corner.

    Components may overlap: together they are a union.
    """
    edges, first = np.unique(surface.edges_sorted, axis=0, return_index=True)
    starts, ways = surface.vertices[edges[:, 0]], np.diff(surface.vertices[edges], axis=1)[:, 0]
    lengths = np.maximum(np.linalg.norm(ways, axis=1), MERGED)
    directions = ways / lengths[:, None]
    # Both ends are left out: rays are traced in single precision, and neighbours are near there.
    origins = starts + END_SHARE * ways
    hits, rays, triangles = surface.ray.intersects_location(origins, directions)
    if len(triangles) == 0:
        return False
    inside = np.linalg.norm(hits - starts[rays], axis=1) < (1.0 - END_SHARE) * lengths[rays]
    touch = (surface.faces[triangles][:, :, None] == edges[rays][:, None, :]).any(axis=(1, 2))
    component = trimesh.graph.connected_component_labels(surface.face_adjacency, len(surface.faces))
    same = component[triangles] == component[surface.edges_face[first][rays]]
    return bool((inside & ~touch & same).any())


def _read_reports(path: Path) -> list[ObjectReport] | None:
    """Returns remembered reports; None when there are none or the file is damaged."""
    try:
        rows = json.loads(path.read_text())
        return [ObjectReport(row["name"], row["status"], tuple(row["problems"]), tuple(row["sides"])) for row in rows]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _write_reports(path: Path, reports: Sequence[ObjectReport]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with new_file(path) as file:
        file.write(json.dumps([asdict(report) for report in reports]).encode())

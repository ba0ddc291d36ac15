"""Rigid objects from URDF files: one link, a visual mesh and convex collision groups (the VGN layout)."""

import os
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import QhullError
from trimesh.transformations import euler_matrix

from icgnet.errors import DataError
from icgnet.objects.model import ObjectModel, check_size, clean_surface, convex_hull

SIZE_RATIO = 2.0
"""Visual and collision geometry that differ in length by more than this are not of one thing."""
NAMED = 200
"""So many characters of a name are repeated in a message."""
SMALLEST_VOLUME = 1e-13
"""A convex piece that encloses less [m^3], a cube of 0.05 mm, is none that the physics could take."""


def read_urdf_object(path: Path, name: str, class_name: str) -> ObjectModel:
    """Returns the object that a URDF with one link describes [m, link frame].

    Mass, inertia and friction are not read: the published object sets hold values that do not belong to the
    sizes, and the simulation draws its own.

    Raises:
        DataError: broken XML, no or several links, no visual or collision geometry, a missing, empty or flat mesh,
            a mesh outside of the URDF's folder, a size that is no object's, a collision piece that encloses nothing,
            or a visual and a collision geometry of different sizes.
    """
    link = _only_link(path)
    visuals = [piece for element in link.findall("visual") for piece in _read_geometry(element, path, split=False)]
    parts = [piece for element in link.findall("collision") for piece in _read_geometry(element, path, split=True)]
    if not visuals:
        raise DataError(f"{path}: the link has no <visual> geometry")
    if not parts:
        raise DataError(f"{path}: the link has no <collision> geometry")
    surface = clean_surface(_joined(visuals), str(path))
    _check_same_size(surface, parts, path)
    check_size(surface, str(path))
    if (smallest := min(abs(part.volume) for part in parts)) < SMALLEST_VOLUME:
        raise DataError(f"{path}: a piece of the collision geometry encloses nothing ({smallest * 1e9:.2g} mm^3)")
    return ObjectModel(name, class_name, surface, tuple(parts))


def read_convex_groups(path: Path) -> list[trimesh.Trimesh]:
    """Returns the convex hull of each group (`o` or `g` line) of an OBJ file, in the order of the file.

    Read here and not by trimesh, which joins groups that share a material. Hulls, because that is what the
    groups mean: an engine that loads such a file makes one convex body of each group.

    Raises:
        DataError: the file has no face, or a group is flat.
    """
    vertices: list[list[float]] = []
    groups: list[set[int]] = [set()]
    try:
        for line in path.read_text().splitlines():
            key, *values = line.split() or [""]
            if key == "v":
                vertices.append([float(value) for value in values[:3]])
            elif key in ("o", "g"):
                groups.append(set())
            elif key == "f":
                indices = (int(value.split("/")[0]) for value in values)
                groups[-1].update(index - 1 if index > 0 else len(vertices) + index for index in indices)
        points = np.array(vertices, np.float64).reshape(-1, 3)
        hulls = [convex_hull(points[sorted(group)]) for group in groups if group]
    except QhullError as error:
        raise DataError(f"{path}: a convex group is flat") from error
    except (OSError, ValueError, IndexError) as error:
        raise DataError(f"{path}: cannot read the convex groups: {str(error).splitlines()[0]}") from error
    if not hulls:
        raise DataError(f"{path}: the mesh is empty (no faces)")
    return hulls


def _joined(meshes: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return trimesh.Trimesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces), process=False)


def _check_same_size(surface: trimesh.Trimesh, parts: list[trimesh.Trimesh], path: Path) -> None:
    """Raises DataError where one of the two is in other units than the other."""
    corners = np.concatenate([part.bounds for part in parts])
    visual, collision = float(surface.extents.max()), float(np.ptp(corners, axis=0).max())
    if not 1.0 / SIZE_RATIO < visual / collision < SIZE_RATIO:
        raise DataError(
            f"{path}: the visual mesh is {visual:.4g} m long, the collision geometry {collision:.4g} m: "
            "are the units right?"
        )


def _only_link(path: Path) -> ElementTree.Element:
    try:
        robot = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise DataError(f"{path}: broken URDF: {error}") from error
    links = robot.findall("link")
    if robot.tag != "robot" or len(links) != 1:
        raise DataError(f"{path}: expected a <robot> with one <link> (a rigid object), found {len(links)} links")
    return links[0]


def _read_geometry(element: ElementTree.Element, path: Path, split: bool) -> list[trimesh.Trimesh]:
    """Returns the meshes of one <visual> or <collision>, in the link frame; `split`: one hull per convex group."""
    geometry = element.find("geometry")
    shape = None if geometry is None else next(iter(geometry), None)
    if shape is None:
        raise DataError(f"{path}: <{element.tag}> without geometry")
    if shape.tag == "mesh":
        meshes = _read_mesh(path.parent / _mesh_name(shape, path), split)
        scale = _vector(shape, "scale", "1 1 1", path)
    else:
        meshes, scale = [_primitive(shape, path)], np.ones(3)
    origin = element.find("origin")
    T_link_geometry = np.eye(4)
    if origin is not None:
        T_link_geometry = euler_matrix(*_vector(origin, "rpy", "0 0 0", path), axes="sxyz")
        T_link_geometry[:3, 3] = _vector(origin, "xyz", "0 0 0", path)
    T_link_mesh = T_link_geometry @ np.diag([*scale, 1.0])
    return [mesh.apply_transform(T_link_mesh) for mesh in meshes]


def _mesh_name(shape: ElementTree.Element, path: Path) -> str:
    name = shape.get("filename")
    if not name:
        raise DataError(f"{path}: <mesh> without a filename")
    name = name.removeprefix("file://")
    inside = os.path.normpath(name)
    if os.path.isabs(inside) or inside.split(os.sep)[0] == "..":
        raise DataError(f"{path}: the mesh {name[:NAMED]!r} must lie in the folder of the URDF, or below it")
    return name


def _read_mesh(path: Path, split: bool) -> list[trimesh.Trimesh]:
    try:
        is_there = path.is_file()
    except OSError as error:  # a name that is too long
        raise DataError(f"{str(path)[:NAMED]}: cannot read the mesh: {error.strerror}") from error
    if not is_there:
        raise DataError(f"{path}: missing mesh")
    if split and path.suffix.lower() == ".obj":
        return read_convex_groups(path)
    mesh = read_mesh(path)
    return [convex_hull(mesh.vertices)] if split else [mesh]


def read_mesh(path: Path) -> trimesh.Trimesh:
    """Returns all triangles of a mesh file, in the file's own units.

    Raises:
        DataError: the file cannot be read or holds no triangles.
    """
    try:
        mesh = trimesh.load_mesh(path, process=False)
        mesh = mesh.to_mesh() if isinstance(mesh, trimesh.Scene) else mesh
    except Exception as error:  # trimesh's readers raise whatever their format's parser raises
        raise DataError(f"{path}: cannot read the mesh: {error}") from error
    if len(mesh.faces) == 0:
        raise DataError(f"{path}: the mesh is empty (no faces)")
    return mesh


def _primitive(shape: ElementTree.Element, path: Path) -> trimesh.Trimesh:
    if shape.tag == "box":
        return trimesh.creation.box(extents=_positive(shape, "size", _vector(shape, "size", None, path), path))
    if shape.tag == "cylinder":
        return trimesh.creation.cylinder(
            radius=_number(shape, "radius", path), height=_number(shape, "length", path), sections=32
        )
    if shape.tag == "sphere":
        return trimesh.creation.icosphere(subdivisions=2, radius=_number(shape, "radius", path))
    raise DataError(f"{path}: unknown geometry <{shape.tag}>; known are mesh, box, cylinder and sphere")


def _vector(element: ElementTree.Element, key: str, default: str | None, path: Path) -> Float[np.ndarray, "3"]:
    text = element.get(key, default)
    try:
        values = np.array([float(value) for value in (text or "").split()])
    except ValueError as error:
        raise DataError(f"{path}: <{element.tag} {key}={text!r}> is not three numbers") from error
    if values.shape != (3,) or not np.isfinite(values).all():
        raise DataError(f"{path}: <{element.tag} {key}={text!r}> is not three numbers")
    return values


def _number(element: ElementTree.Element, key: str, path: Path) -> float:
    text = element.get(key)
    try:
        value = float(text or "")
    except ValueError as error:
        raise DataError(f"{path}: <{element.tag} {key}={text!r}> is not a number") from error
    return float(_positive(element, key, np.array([value]), path)[0])


def _positive(
    element: ElementTree.Element, key: str, lengths: Float[np.ndarray, "k"], path: Path
) -> Float[np.ndarray, "k"]:
    if not (np.isfinite(lengths).all() and (lengths > 0).all()):
        raise DataError(f"{path}: <{element.tag} {key}={element.get(key)!r}> must be positive [m]")
    return lengths

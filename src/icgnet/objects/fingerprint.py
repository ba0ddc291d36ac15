"""Short hashes of what objects are made from, by which a changed object is noticed."""

import hashlib
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path

DIGITS = 16


def hash_texts(*texts: str) -> str:
    """Returns a short hash of some texts."""
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:DIGITS]


def hash_files(path: Path, settings: Sequence[str]) -> str:
    """Returns a short hash of what is in an object's file and in the meshes that it names, and of how they are read.

    Files that are missing or broken count as such: that too is a state that may change.

    Args:
        path: a URDF or a mesh.
        settings: what else decides the object's geometry.
    """
    content = [_hash_file(path), *(_hash_file(mesh) for mesh in _named_meshes(path))]
    return hash_texts(*settings, *content)


def _hash_file(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return "unreadable"


def _named_meshes(path: Path) -> list[Path]:
    """Returns the meshes that a URDF names, in its order; none for other files and broken ones."""
    if path.suffix.lower() != ".urdf":
        return []
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError):
        return []
    names = (mesh.get("filename", "") for mesh in root.iter("mesh"))
    return [path.parent / name.removeprefix("file://") for name in names]

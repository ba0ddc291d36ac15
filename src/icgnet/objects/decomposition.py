"""Convex pieces of meshes that come without them."""

import zipfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float

from icgnet.files import new_file
from icgnet.geometry.signed_distance import surface_hash
from icgnet.objects.model import solid_hull

CONCAVITY = 0.05
"""How far a piece may dip below its hull, CoACD's measure: smaller gives more and truer pieces."""


def decompose(mesh: trimesh.Trimesh, cache: Path) -> tuple[trimesh.Trimesh, ...]:
    """Returns convex pieces that together stand for a mesh, from the folder `cache` if they were made before.

    Uses CoACD; where it is not installed (`pip install icgnet[decompose]`) the single convex hull: hollows are then
    closed for the physics, which `decomposition_notices` says.
    """
    if mesh.is_convex:
        return (solid_hull(mesh.vertices),)
    path = cache / f"{surface_hash(mesh, f'coacd {CONCAVITY}')}.npz"
    pieces = _read_pieces(path)
    if pieces is None:
        pieces = _run_coacd(mesh)
        if pieces is None:
            return (solid_hull(mesh.vertices),)
        _write_pieces(path, pieces)
    return tuple(solid_hull(piece) for piece in pieces)


def decomposition_method() -> str:
    """Returns how meshes are decomposed here: the pieces depend on whether CoACD is installed."""
    return f"coacd {CONCAVITY}" if find_spec("coacd") else "hull"


def decomposition_notices() -> list[str]:
    """Returns a line on what meshes lose where CoACD is not installed."""
    if find_spec("coacd"):
        return []
    return [
        "CoACD is not installed (pip install 'icgnet[decompose]'): the physics sees the convex hull of a mesh, "
        "so that hollows and handles are closed"
    ]


def _run_coacd(mesh: trimesh.Trimesh) -> list[Float[np.ndarray, "_ 3"]] | None:
    try:
        import coacd  # pyright: ignore[reportMissingImports]
    except ImportError:
        return None
    coacd.set_log_level("error")
    pieces = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), threshold=CONCAVITY, max_convex_hull=48)
    return [np.asarray(vertices, np.float64) for vertices, _ in pieces] or None


def _read_pieces(path: Path) -> list[Float[np.ndarray, "_ 3"]] | None:
    """Returns stored pieces; None when there are none or the file is damaged."""
    try:
        with np.load(path) as arrays:
            return np.split(arrays["points"], np.cumsum(arrays["counts"])[:-1])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _write_pieces(path: Path, pieces: list[Float[np.ndarray, "_ 3"]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with new_file(path) as file:
        np.savez_compressed(file, points=np.concatenate(pieces), counts=[len(piece) for piece in pieces])

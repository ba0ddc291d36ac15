"""Convex pieces of meshes that come without them."""

import zipfile
from importlib.util import find_spec
from itertools import combinations
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import ConvexHull

from icgnet.files import new_file
from icgnet.geometry.signed_distance import surface_hash
from icgnet.objects.model import solid_hull

CONCAVITY = 0.07
"""How far a piece may dip below its hull, CoACD's measure: smaller gives more and truer pieces."""
MOST_PIECES = 24
"""The physics is slow with objects of more pieces: nearby ones are joined."""
NEARLY_CONVEX = 0.98
"""A closed component that fills so much of its hull is its own piece."""
SEARCH_NODES, SEARCH_ITERATIONS = 10, 40
"""Of CoACD's search for the best cuts: less than its usual effort, which takes minutes for some scans."""
SETTINGS = f"coacd {CONCAVITY} {MOST_PIECES} {NEARLY_CONVEX} {SEARCH_NODES} {SEARCH_ITERATIONS}"

Points = Float[np.ndarray, "_ 3"]


def decompose(mesh: trimesh.Trimesh, cache: Path) -> tuple[trimesh.Trimesh, ...]:
    """Returns convex pieces that together stand for a mesh, from the folder `cache` if they were made before.

    Closed components that are convex, or nearly so, are pieces already; the others are cut by CoACD. Where CoACD is
    not installed (`pip install icgnet[decompose]`), the single convex hull is returned: hollows are then closed for the
    physics, which `decomposition_notices` says.
    """
    if mesh.is_convex:
        return (solid_hull(mesh.vertices),)
    path = cache / f"{surface_hash(mesh, SETTINGS)}.npz"
    pieces = _read_pieces(path)
    if pieces is None:
        if not find_spec("coacd"):
            return (solid_hull(mesh.vertices),)
        pieces = _cut(mesh)
        _write_pieces(path, pieces)
    return tuple(solid_hull(piece) for piece in pieces)


def decomposition_method() -> str:
    """Returns how meshes are decomposed here: the pieces depend on whether CoACD is installed."""
    return SETTINGS if find_spec("coacd") else "hull"


def decomposition_notices() -> list[str]:
    """Returns a line on what meshes lose where CoACD is not installed."""
    if find_spec("coacd"):
        return []
    return [
        "CoACD is not installed (pip install 'icgnet[decompose]'): the physics sees the convex hull of a mesh, "
        "so that hollows and handles are closed"
    ]


def _cut(mesh: trimesh.Trimesh) -> list[Points]:
    components = mesh.split(only_watertight=False) if mesh.body_count > 1 else [mesh]
    pieces = [
        piece
        for component in components
        for piece in ([component.vertices] if _is_nearly_convex(component) else _run_coacd(component))
    ]
    return _join(pieces)


def _join(pieces: list[Points]) -> list[Points]:
    """Returns `MOST_PIECES` at most: again and again, those two are joined whose hull adds the least volume."""
    pieces = list(pieces)
    volumes = [float(solid_hull(piece).volume) for piece in pieces]
    excess = len(pieces) - MOST_PIECES
    added = {pair: _added(pieces, volumes, *pair) for pair in combinations(range(len(pieces)), 2) if excess > 0}
    for _ in range(excess):
        first, second = min(added, key=added.__getitem__)
        pieces[first] = np.concatenate([pieces[first], pieces[second]])
        volumes[first] = float(solid_hull(pieces[first]).volume)
        added = {pair: volume for pair, volume in added.items() if not {first, second} & set(pair)}
        pieces[second] = pieces[second][:0]
        others = [index for index, piece in enumerate(pieces) if len(piece) and index != first]
        added |= {(first, other): _added(pieces, volumes, first, other) for other in others}
    return [piece for piece in pieces if len(piece)]


def _added(pieces: list[Points], volumes: list[float], first: int, second: int) -> float:
    """Returns the volume of the hull of two pieces beyond their own [m^3]."""
    union = ConvexHull(np.concatenate([pieces[first], pieces[second]]), qhull_options="QJ").volume
    return float(union - volumes[first] - volumes[second])


def _is_nearly_convex(component: trimesh.Trimesh) -> bool:
    return bool(component.is_watertight and component.volume > NEARLY_CONVEX * solid_hull(component.vertices).volume)


def _run_coacd(mesh: trimesh.Trimesh) -> list[Points]:
    """Returns CoACD's pieces, the same ones on any number of threads; the hull where it finds none."""
    import coacd  # pyright: ignore[reportMissingImports]

    coacd.set_log_level("error")
    pieces = coacd.run_coacd(
        coacd.Mesh(mesh.vertices, mesh.faces),
        threshold=CONCAVITY,
        max_convex_hull=MOST_PIECES,
        mcts_nodes=SEARCH_NODES,
        mcts_iterations=SEARCH_ITERATIONS,
        # A closed mesh is cut as it is: CoACD's remeshing would round it, and is slow.
        preprocess_mode="off" if mesh.is_watertight else "on",
    )
    return [np.asarray(vertices, np.float64) for vertices, _ in pieces] or [mesh.vertices]


def _read_pieces(path: Path) -> list[Points] | None:
    """Returns stored pieces; None when there are none or the file is damaged."""
    try:
        with np.load(path) as arrays:
            return np.split(arrays["points"], np.cumsum(arrays["counts"])[:-1])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _write_pieces(path: Path, pieces: list[Points]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with new_file(path) as file:
        np.savez_compressed(file, points=np.concatenate(pieces), counts=[len(piece) for piece in pieces])

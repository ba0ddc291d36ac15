"""Object sets: where scenes get their objects from."""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from icgnet.errors import InputError
from icgnet.objects.base import ObjectSet, cache_directory, check_kind_and_split
from icgnet.objects.kinds import KINDS, SPLITS, Kind, Split, Units
from icgnet.objects.mesh_folder import MeshFolderObjectSet
from icgnet.objects.mixed_set import MixedObjectSet
from icgnet.objects.procedural import ProceduralObjectSet
from icgnet.objects.urdf_set import UrdfObjectSet, is_vgn_layout

__all__ = [
    "KINDS",
    "SPLITS",
    "Kind",
    "ObjectSet",
    "Split",
    "cache_directory",
    "check_kind_and_split",
    "load_object_set",
    "warm_cache",
]


def load_object_set(source: str | Path, units: Units | None = None) -> ObjectSet:
    """Returns the object set that `source` names.

    Args:
        source: "procedural" (the embedded set), a folder in the VGN layout (`packed/`, `pile/` with URDFs), or a
            folder of OBJ, PLY, STL or GLB meshes or of single URDFs; or several of these with commas between them
            ("procedural,my_objects"), which are mixed.
        units: units of a folder of meshes, if its `objects.yaml` does not say them.

    Raises:
        InputError: there is no such folder or set, or two that are mixed have the same name.
        DataError: the folder holds no objects, or its lists are broken.
    """
    parts = [part.strip() for part in str(source).split(",")]
    if len(parts) > 1 and not Path(source).expanduser().is_dir():
        return MixedObjectSet([load_object_set(part, units) for part in parts])
    if str(source) == "procedural":
        return ProceduralObjectSet()
    directory = Path(source).expanduser()
    if not directory.is_dir():
        raise InputError(f'no object set {str(source)!r}: give "procedural" or an existing folder of URDFs or meshes')
    if is_vgn_layout(directory):
        return UrdfObjectSet(directory)
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

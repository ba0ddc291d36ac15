"""Scene recipes: which objects stand where, and what grasping them at some contacts gave. One Parquet row a scene.

See docs/data_format.md for the columns.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Bool, Float, Int, UInt8, UInt16

from icgnet.errors import DataError
from icgnet.files import new_file
from icgnet.geometry.transforms import make_transform, quaternion_to_matrix
from icgnet.grasping.frame import APPROACH_ANGLES
from icgnet.objects.object_set import Kind, Split
from icgnet.simulation.scene import PlacedObject, Scene

FORMAT_VERSION = 1
ANGLES = len(APPROACH_ANGLES)
MANIFEST = "manifest.json"

_VECTOR = pa.list_(pa.float32(), 3)
SCHEMA = pa.schema(
    [
        ("scene_id", pa.int64()),
        ("kind", pa.string()),
        ("object_set", pa.string()),
        ("split", pa.string()),
        ("seed", pa.int64()),
        (
            "objects",
            pa.list_(
                pa.struct(
                    [
                        ("name", pa.string()),
                        ("class_name", pa.string()),
                        ("scale", pa.float32()),
                        ("position", _VECTOR),
                        ("quaternion", pa.list_(pa.float32(), 4)),
                    ]
                )
            ),
        ),
        (
            "contacts",
            pa.list_(
                pa.struct(
                    [
                        ("position", _VECTOR),
                        ("normal", _VECTOR),
                        ("object", pa.int8()),
                        ("width", pa.float32()),
                        ("success", pa.uint16()),
                        ("collided", pa.uint16()),
                        ("disturbed", pa.uint16()),
                    ]
                )
            ),
        ),
    ]
)


@dataclass(frozen=True, eq=False)
class RecipeObject:
    """An object of a recipe: key and class in its set, scale, position [m] and wxyz quaternion in the world."""

    name: str
    class_name: str
    scale: float
    position: Float[np.ndarray, "3"]
    quaternion: Float[np.ndarray, "4"]


@dataclass(frozen=True, eq=False)
class RecipeContacts:
    """Labelled contacts; bit i of a label belongs to approach angle i.

    Attributes:
        positions: [g 3] world frame [m].
        normals: [g 3] outward unit normals, world frame.
        objects: [g] index into the recipe's objects.
        widths: [g] distance between the fingers [m]; see `icgnet.simulation.trials.Labels`.
        success: [g] the object was held after the lift.
        collided: [g] the open hand does not get there.
        disturbed: [g] the trial moved another object.
    """

    positions: Float[np.ndarray, "g 3"]
    normals: Float[np.ndarray, "g 3"]
    objects: Int[np.ndarray, "g"]
    widths: Float[np.ndarray, "g"]
    success: UInt16[np.ndarray, "g"]
    collided: UInt16[np.ndarray, "g"]
    disturbed: UInt16[np.ndarray, "g"]

    def __len__(self) -> int:
        return len(self.positions)


@dataclass(frozen=True)
class Recipe:
    """One labelled scene. `seed` is that of the whole run; with `scene_id` it gives the scene's random stream."""

    scene_id: int
    kind: Kind
    object_set: str
    split: Split
    seed: int
    objects: tuple[RecipeObject, ...]
    contacts: RecipeContacts

    def labels(self) -> UInt8[np.ndarray, "g a"]:
        """Success of every contact and approach angle, 0 or 1."""
        return unpack_bits(self.contacts.success).astype(np.uint8)

    def scene(self) -> Scene:
        """The objects with their poses."""
        return Scene(
            self.kind,
            tuple(
                PlacedObject(
                    placed.name,
                    placed.scale,
                    make_transform(quaternion_to_matrix(placed.quaternion), placed.position),
                )
                for placed in self.objects
            ),
        )


def pack_bits(flags: Bool[np.ndarray, "g a"]) -> UInt16[np.ndarray, "g"]:
    """One integer a row; bit i is column i."""
    return (flags @ (1 << np.arange(ANGLES))).astype(np.uint16)


def unpack_bits(bits: UInt16[np.ndarray, "g"]) -> Bool[np.ndarray, "g a"]:
    """The inverse of `pack_bits`."""
    return (bits[:, None] >> np.arange(ANGLES)) & 1 == 1


def write_shard(path: Path, recipes: Sequence[Recipe]) -> None:
    """Writes recipes to a Parquet file that appears complete or not at all.

    Raises:
        DataError: the system cannot write it, for example because the disk is full.
    """
    table = pa.Table.from_pylist([_to_row(recipe) for recipe in recipes], SCHEMA)
    with new_file(path) as file:
        pq.write_table(table, file, compression="zstd")


def read_recipes(directory: str | Path) -> list[Recipe]:
    """All recipes of a folder that `icgnet generate` wrote, in the order of their scene ids.

    Raises:
        DataError: no such folder, no shards, a file that is truncated or has other columns, or another format version.
    """
    directory = Path(directory)
    read_manifest(directory)
    shards = sorted(directory.glob("*.parquet"))
    if not shards:
        raise DataError(f"{directory}: no recipes (*.parquet) found")
    return [recipe for shard in shards for recipe in read_shard(shard)]


def read_manifest(directory: Path) -> dict[str, object]:
    """The manifest of a recipe folder.

    Raises:
        DataError: missing or broken manifest, or one of another format version.
    """
    path = directory / MANIFEST
    try:
        manifest = json.loads(path.read_text())
        version = manifest["format_version"]
    except FileNotFoundError as error:
        raise DataError(f"{directory}: not a recipe folder, it has no {MANIFEST}") from error
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"{path}: broken manifest: {error}") from error
    if version != FORMAT_VERSION:
        raise DataError(f"{path}: format version {str(version)[:40]}, but this icgnet reads {FORMAT_VERSION}")
    return manifest


def read_shard(path: Path) -> list[Recipe]:
    """The recipes of one Parquet file.

    Raises:
        DataError: the file is truncated or not Parquet, or has other columns.
    """
    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise DataError(f"{path}: {_unreadable(error)}") from error
    if not table.schema.equals(SCHEMA):
        raise DataError(
            f"{path}: columns differ from recipe format {FORMAT_VERSION}: {_schema_difference(table.schema)}"
        )
    return _from_table(table)


def count_scenes(path: Path) -> int:
    """The number of recipes in a Parquet file, from its last bytes alone.

    Raises:
        DataError: the file is truncated or not Parquet.
    """
    try:
        return pq.read_metadata(path).num_rows
    except (pa.ArrowException, OSError) as error:
        raise DataError(f"{path}: {_unreadable(error)}") from error


def _unreadable(error: Exception) -> str:
    return f"not a readable Parquet file (truncated?): {str(error).splitlines()[0]}"


def _schema_difference(schema: pa.Schema) -> str:
    for field in SCHEMA:
        if field.name not in schema.names:
            return f"{field.name} is missing"
        if schema.field(field.name).type != field.type:
            return f"{field.name} is {schema.field(field.name).type}"
    return f"unknown {sorted(set(schema.names) - set(SCHEMA.names))}"


def _to_row(recipe: Recipe) -> dict[str, object]:
    contacts = recipe.contacts
    columns = {
        "position": contacts.positions.astype(np.float32).tolist(),
        "normal": contacts.normals.astype(np.float32).tolist(),
        "object": contacts.objects.tolist(),
        "width": contacts.widths.astype(np.float32).tolist(),
        "success": contacts.success.tolist(),
        "collided": contacts.collided.tolist(),
        "disturbed": contacts.disturbed.tolist(),
    }
    return {
        "scene_id": recipe.scene_id,
        "kind": recipe.kind,
        "object_set": recipe.object_set,
        "split": recipe.split,
        "seed": recipe.seed,
        "objects": [
            {
                "name": placed.name,
                "class_name": placed.class_name,
                "scale": placed.scale,
                "position": placed.position.tolist(),
                "quaternion": placed.quaternion.tolist(),
            }
            for placed in recipe.objects
        ],
        "contacts": [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)],
    }


def _from_table(table: pa.Table) -> list[Recipe]:
    table = table.combine_chunks()
    # Contacts are many: their columns are read as whole arrays and cut by scene, without a Python object each.
    contacts = table["contacts"].combine_chunks()
    starts = contacts.offsets.to_numpy()
    fields = contacts.values
    columns = {
        name: fields.field(name).to_numpy(zero_copy_only=False)
        for name in ("object", "width", "success", "collided", "disturbed")
    }
    positions, normals = (fields.field(name).values.to_numpy().reshape(-1, 3) for name in ("position", "normal"))
    rows = table.drop_columns(["contacts"]).to_pylist()
    return [
        Recipe(
            scene_id=row["scene_id"],
            kind=row["kind"],
            object_set=row["object_set"],
            split=row["split"],
            seed=row["seed"],
            objects=tuple(
                RecipeObject(
                    placed["name"],
                    placed["class_name"],
                    placed["scale"],
                    np.array(placed["position"], np.float32),
                    np.array(placed["quaternion"], np.float32),
                )
                for placed in row["objects"]
            ),
            contacts=RecipeContacts(
                positions=positions[own],
                normals=normals[own],
                objects=columns["object"][own].astype(np.int64),
                widths=columns["width"][own],
                success=columns["success"][own],
                collided=columns["collided"][own],
                disturbed=columns["disturbed"][own],
            ),
        )
        for row, own in zip(rows, map(slice, starts[:-1], starts[1:]), strict=True)
    ]

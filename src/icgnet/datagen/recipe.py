"""Scene recipes: which objects stand where, and what grasping them at some contacts gave. One Parquet row a scene.

See docs/data_format.md for the columns.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Bool, Float, Int, UInt8, UInt16

from icgnet.errors import DataError, InputError
from icgnet.files import new_file
from icgnet.geometry.transforms import make_transform, quaternion_to_matrix
from icgnet.grasping.frame import APPROACH_ANGLES
from icgnet.grasping.gripper import Gripper
from icgnet.objects.classes import check_class_list
from icgnet.objects.kinds import Kind, Split
from icgnet.simulation.scene import PlacedObject, Scene
from icgnet.simulation.surroundings import ENDLESS, Structure, Surroundings

FORMAT_VERSION = 3
"""Since 2, folder and files name the hand and the classes of their labels; since 3, every recipe names its hand, its
surroundings and the stretch of its objects."""
ANGLES = len(APPROACH_ANGLES)
MANIFEST = "manifest.json"
METADATA_KEY = b"icgnet"
"""Where the schema of a Parquet file holds its `LabelHeader`, as JSON."""

_VECTOR = pa.list_(pa.float32(), 3)
SCHEMA = pa.schema(
    [
        ("scene_id", pa.int64()),
        ("kind", pa.string()),
        ("object_set", pa.string()),
        ("split", pa.string()),
        ("seed", pa.int64()),
        ("gripper", pa.string()),
        ("extent", pa.list_(pa.float32())),
        ("structures", pa.list_(pa.struct([("name", pa.string()), ("corners", pa.list_(pa.float32()))]))),
        (
            "objects",
            pa.list_(
                pa.struct(
                    [
                        ("name", pa.string()),
                        ("class_name", pa.string()),
                        ("scale", pa.float32()),
                        ("stretch", _VECTOR),
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


@dataclass(frozen=True)
class LabelHeader:
    """What the labels of a folder, and of every file in it, are about.

    Attributes:
        gripper: the hand that grasped.
        classes: names of all object classes, in the order of a network's outputs.
    """

    gripper: Gripper
    classes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The header as plain values: entries of the manifest and of the metadata of Parquet files."""
        return {
            "format_version": FORMAT_VERSION,
            "gripper": self.gripper.to_dict(),
            "classes": list(self.classes),
        }

    @classmethod
    def from_dict(cls, values: Any, path: Path) -> "LabelHeader":
        """The header among plain values that were read from a file.

        Raises:
            DataError: another format version, or a missing or broken hand or class list; the message names the file.
        """
        if not isinstance(values, dict) or "format_version" not in values:
            raise DataError(f"{path}: broken, it does not say its format_version")
        if values["format_version"] != FORMAT_VERSION:
            raise DataError(
                f"{path}: format version {str(values['format_version'])[:40]}, but this version of icgnet reads "
                f"{FORMAT_VERSION}: make the scenes again with icgnet generate, in another folder"
            )
        try:
            return cls(Gripper.from_dict(values.get("gripper")), check_class_list(values.get("classes")))
        except InputError as error:
            raise DataError(f"{path}: does not describe a gripper and classes: {error}") from error

    def differences(self, other: "LabelHeader") -> list[str]:
        """In what these labels are about something else than the others; grippers that are the same hand do not."""
        hands = self.gripper.differences(other.gripper)
        named = f"hand {self.gripper.name!r} instead of {other.gripper.name!r} ({', '.join(hands)})"
        listed = f"classes {', '.join(self.classes)} instead of {', '.join(other.classes)}"
        return [named] * bool(hands) + [listed] * (self.classes != other.classes)


@dataclass(frozen=True, eq=False)
class RecipeObject:
    """An object of a recipe: key and class in its set, scale, position [m] and wxyz quaternion in the world.

    `stretch` holds further factors along the axes of its mesh.
    """

    name: str
    class_name: str
    scale: float
    position: Float[np.ndarray, "3"]
    quaternion: Float[np.ndarray, "4"]
    stretch: tuple[float, float, float] = (1.0, 1.0, 1.0)


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


@dataclass(frozen=True, eq=False)
class Recipe:
    """One labelled scene.

    Attributes:
        scene_id: number of the scene in its run.
        kind: of the scene.
        object_set: where its objects come from.
        split: which of them.
        seed: of the whole run; with `scene_id` it gives the scene's random stream.
        gripper: the hand that grasped.
        objects: what can be grasped.
        contacts: what grasping them gave.
        surroundings: what carries the objects and what stands around them.
    """

    scene_id: int
    kind: Kind
    object_set: str
    split: Split
    seed: int
    gripper: Gripper
    objects: tuple[RecipeObject, ...]
    contacts: RecipeContacts
    surroundings: Surroundings = ENDLESS

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
                    placed.stretch,
                )
                for placed in self.objects
            ),
            self.surroundings,
        )


def pack_bits(flags: Bool[np.ndarray, "g a"]) -> UInt16[np.ndarray, "g"]:
    """One integer a row; bit i is column i."""
    return (flags @ (1 << np.arange(ANGLES))).astype(np.uint16)


def unpack_bits(bits: UInt16[np.ndarray, "g"]) -> Bool[np.ndarray, "g a"]:
    """The inverse of `pack_bits`."""
    return (bits[:, None] >> np.arange(ANGLES)) & 1 == 1


def write_shard(path: Path, recipes: Sequence[Recipe], header: LabelHeader) -> None:
    """Writes recipes to a Parquet file that appears complete or not at all.

    Args:
        path: of the file.
        recipes: its rows.
        header: what the labels are about.

    Raises:
        DataError: the system cannot write it, for example because the disk is full.
    """
    schema = SCHEMA.with_metadata({METADATA_KEY: json.dumps(header.to_dict())})
    table = pa.Table.from_pylist([_to_row(recipe) for recipe in recipes], schema)
    with new_file(path) as file:
        floats, others = _columns(schema)
        columns: Any = {"use_byte_stream_split": floats, "use_dictionary": others}  # typed as truth values there
        pq.write_table(table, file, compression="zstd", **columns)


def _columns(schema: pa.Schema) -> tuple[list[str], list[str]]:
    """Paths of the columns of floats, whose bytes compress better by their place, and of all others."""
    found: tuple[list[str], list[str]] = ([], [])

    def visit(name: str, kind: pa.DataType) -> None:
        if pa.types.is_struct(kind):
            for field in kind:
                visit(f"{name}.{field.name}", field.type)
        elif pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
            visit(f"{name}.list.element", kind.value_type)
        else:
            found[not pa.types.is_floating(kind)].append(name)

    for field in schema:
        visit(field.name, field.type)
    return found


def read_recipes(directory: str | Path) -> list[Recipe]:
    """All recipes of a folder that `icgnet generate` wrote, in the order of their scene ids.

    Raises:
        DataError: no such folder, no shards, a file that is truncated or has other columns, another format version, or
            files whose labels are of another hand or other classes than the manifest says.
    """
    directory = Path(directory)
    header = read_label_header(directory)
    shards = sorted(directory.glob("*.parquet"))
    if not shards:
        raise DataError(f"{directory}: no recipes (*.parquet) found")
    return [recipe for shard in shards for recipe in read_shard(shard, header)]


def read_label_header(directory: Path) -> LabelHeader:
    """What the labels of a folder are about, from its manifest.

    Raises:
        DataError: see `read_manifest`.
    """
    return LabelHeader.from_dict(read_manifest(directory), directory / MANIFEST)


def read_manifest(directory: Path) -> dict[str, object]:
    """The manifest of a recipe folder.

    Raises:
        DataError: missing or broken manifest, one of another format version, or without gripper and classes.
    """
    path = directory / MANIFEST
    try:
        manifest = json.loads(path.read_text())
    except FileNotFoundError as error:
        raise DataError(f"{directory}: not a recipe folder, it has no {MANIFEST}") from error
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{path}: broken manifest: {error}") from error
    LabelHeader.from_dict(manifest, path)
    return manifest


def read_shard(path: Path, header: LabelHeader) -> list[Recipe]:
    """The recipes of one Parquet file.

    Args:
        path: of the file.
        header: what its labels must be about.

    Raises:
        DataError: the file is truncated or not Parquet, has other columns, or its labels are about something else.
    """
    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise DataError(f"{path}: {_unreadable(error)}") from error
    if not table.schema.equals(SCHEMA):
        raise DataError(
            f"{path}: columns differ from recipe format {FORMAT_VERSION}: {_schema_difference(table.schema)}"
        )
    differences = _file_header(table.schema, path).differences(header)
    if differences:
        raise DataError(f"{path}: its labels are not about what the folder's are: {'; '.join(differences)}")
    return _from_table(table)


def _file_header(schema: pa.Schema, path: Path) -> LabelHeader:
    try:
        values = json.loads((schema.metadata or {}).get(METADATA_KEY, b"{}"))
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: its metadata are no JSON: {str(error)[:200]}") from error
    return LabelHeader.from_dict(values, path)


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
        "gripper": json.dumps(recipe.gripper.to_dict()),
        "extent": recipe.surroundings.extent,
        "structures": [
            {"name": each.name, "corners": each.corners.ravel().tolist()} for each in recipe.surroundings.structures
        ],
        "objects": [
            {
                "name": placed.name,
                "class_name": placed.class_name,
                "scale": placed.scale,
                "stretch": placed.stretch,
                "position": placed.position.tolist(),
                "quaternion": placed.quaternion.tolist(),
            }
            for placed in recipe.objects
        ],
        "contacts": [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)],
    }


@lru_cache(maxsize=256)
def _gripper(text: str) -> Gripper:
    """The hand of a row; most rows have the same one."""
    return Gripper.from_dict(json.loads(text))


def _surroundings(row: dict[str, Any]) -> Surroundings:
    structures = tuple(
        Structure(each["name"], np.array(each["corners"], np.float32).reshape(-1, 3)) for each in row["structures"]
    )
    return Surroundings(row["extent"] and tuple(row["extent"]), structures)


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
            gripper=_gripper(row["gripper"]),
            surroundings=_surroundings(row),
            objects=tuple(
                RecipeObject(
                    placed["name"],
                    placed["class_name"],
                    placed["scale"],
                    np.array(placed["position"], np.float32),
                    np.array(placed["quaternion"], np.float32),
                    tuple(placed["stretch"]),
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

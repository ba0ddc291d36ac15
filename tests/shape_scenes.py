"""A small world of boxes, cylinders and balls with recipes whose labels follow a simple rule."""

import json
from pathlib import Path

import numpy as np
import trimesh

from icgnet.datagen.recipe import MANIFEST, LabelHeader, Recipe, RecipeContacts, RecipeObject, pack_bits, write_shard
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.frame import grasp_rotations
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.objects.classes import CLASSES
from icgnet.objects.model import ObjectModel
from icgnet.objects.object_set import ObjectSet

SHAPES = {
    "packed/box": ("box", trimesh.creation.box((0.04, 0.05, 0.09))),
    "packed/can": ("can", trimesh.creation.cylinder(0.022, 0.07, sections=24)),
    "packed/ball": ("ball", trimesh.creation.icosphere(2, 0.03)),
}
PLACES = [(0.09, 0.09), (0.21, 0.10), (0.15, 0.21)]


class ShapeSet(ObjectSet):
    """The three shapes, for any kind and split."""

    def __init__(self) -> None:
        super().__init__("shapes")

    def names(self, kind, split):
        return tuple(SHAPES)

    def class_name(self, key):
        return SHAPES[key][0]

    def fingerprint(self, key):
        return key

    def _load(self, key):
        name, mesh = SHAPES[key]
        return ObjectModel(key, name, mesh, (mesh,))


def make_recipe(scene_id: int, split: str = "train", contacts: int = 60, gripper: Gripper | None = None) -> Recipe:
    """The three shapes side by side; a grasp succeeds on a wall when the hand comes from above."""
    rng = np.random.default_rng(scene_id)
    objects, parts = [], []
    for index, key in enumerate(rng.permutation(list(SHAPES))):
        mesh = SHAPES[key][1]
        yaw = rng.uniform(0, 2 * np.pi)
        position = np.array([*PLACES[index], TABLE_HEIGHT - mesh.bounds[0, 2]], np.float32)
        quaternion = np.array([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)], np.float32)
        objects.append(RecipeObject(str(key), SHAPES[key][0], 1.0, position, quaternion))
        turn = trimesh.transformations.rotation_matrix(yaw, (0, 0, 1))[:3, :3]
        points, faces = trimesh.sample.sample_surface(mesh, contacts // 3, seed=scene_id)
        parts.append((np.asarray(points) @ turn.T + position, mesh.face_normals[faces] @ turn.T, index))
    positions, normals = (np.concatenate([part[k] for part in parts]).astype(np.float32) for k in (0, 1))
    owners = np.concatenate([np.full(len(part[0]), part[2]) for part in parts])
    from_above = grasp_rotations(normals)[:, :, 2, 2] < -0.7
    success = pack_bits(from_above & (np.abs(normals[:, 2:]) < 0.5))
    nothing = np.zeros(len(owners), np.uint16)
    widths = np.full(len(owners), 0.05, np.float32)
    return Recipe(
        scene_id=scene_id,
        kind="packed",
        object_set="shapes",
        split=split,
        seed=0,
        gripper=gripper or HEADER.gripper,
        objects=tuple(objects),
        contacts=RecipeContacts(positions, normals, owners, widths, success, nothing, nothing),
    )


HEADER = LabelHeader(load_gripper("franka"), CLASSES)


def write_recipes(folder: Path, train: int = 4, val: int = 2, header: LabelHeader = HEADER) -> None:
    """Makes a folder of recipes as `icgnet generate` does."""
    folder.mkdir(parents=True)
    (folder / MANIFEST).write_text(json.dumps(header.to_dict()))
    recipes = [
        make_recipe(scene_id, "train" if scene_id < train else "val", gripper=header.gripper)
        for scene_id in range(train + val)
    ]
    write_shard(folder / "scenes.parquet", recipes, header)

"""From a random stream to one labelled scene."""

import logging
from dataclasses import replace

import numpy as np

from icgnet.datagen.config import LabelSettings
from icgnet.datagen.recipe import Recipe, RecipeContacts, RecipeObject, pack_bits
from icgnet.errors import InputError
from icgnet.geometry.transforms import matrix_to_quaternion
from icgnet.grasping.gripper import Gripper
from icgnet.objects.base import UnusableObjectError
from icgnet.objects.kinds import WIDE_KINDS, Kind, Split
from icgnet.objects.object_set import ObjectSet
from icgnet.simulation.config import Physics
from icgnet.simulation.contacts import sample_contacts
from icgnet.simulation.layouts import NothingFitsError
from icgnet.simulation.physics import scene_bodies
from icgnet.simulation.scene import Scene, world_mesh
from icgnet.simulation.scenes import spawn_scene
from icgnet.simulation.trials import Trials

_LOG = logging.getLogger(__name__)

MAX_EMPTY_SCENES = 100  # this many scenes without any object in a row mean that the object set is unusable


def scene_rng(seed: int, scene_id: int) -> np.random.Generator:
    """The random stream of a scene: child number `scene_id` of the run's seed, on any number of workers."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(scene_id,)))


def label_scene(
    scene_id: int, seed: int, kind: Kind, split: Split, object_set: ObjectSet, gripper: Gripper, settings: LabelSettings
) -> Recipe:
    """A random scene with labelled contacts.

    Objects that cannot be loaded, or that the physics engine cannot take, are left out, with a line in the log, and the
    scene is begun anew.

    Raises:
        InputError: the object set has no objects for this kind and split, or none that stay in the workspace.
        DataError: an object cannot be used that was made here.
    """
    while True:
        try:
            return _label(scene_id, seed, kind, split, object_set, gripper, settings)
        except UnusableObjectError as error:
            object_set = object_set.without({error.name: error.reason})
            _LOG.warning("warning: %s; left out of scene %d", error, scene_id)


def _label(
    scene_id: int, seed: int, kind: Kind, split: Split, object_set: ObjectSet, gripper: Gripper, settings: LabelSettings
) -> Recipe:
    rng = scene_rng(seed, scene_id)
    scene = _spawn(kind, object_set, split, rng, settings)
    wide = kind in WIDE_KINDS
    count = settings.contacts_per_object * len(scene.objects) if wide else settings.contacts
    contacts = sample_contacts([world_mesh(placed, object_set) for placed in scene.objects], count, rng)
    variation = settings.variation
    weight = {"density": rng.uniform(*variation.density)} if wide else {"object_mass": rng.uniform(*variation.mass)}
    physics = replace(_physics(kind, settings.physics), **weight, pad_friction=rng.uniform(*variation.pad_friction))
    trials = Trials(scene_bodies(scene, object_set), gripper, physics, scene.surroundings)
    labels = trials.label(contacts, rng, settings.jitter)
    return Recipe(
        scene_id,
        kind,
        object_set.name,
        split,
        seed,
        gripper,
        _recipe_objects(scene, object_set),
        RecipeContacts(
            positions=contacts.positions.astype(np.float32),
            normals=contacts.normals.astype(np.float32),
            objects=contacts.objects,
            widths=labels.widths.astype(np.float32),
            success=pack_bits(labels.success),
            collided=pack_bits(labels.collided),
            disturbed=pack_bits(labels.disturbed),
        ),
        scene.surroundings,
    )


def _physics(kind: Kind, physics: Physics) -> Physics:
    """The settings for a kind of scenes: in wide ones density decides on the masses."""
    return replace(physics, object_mass=None) if kind in WIDE_KINDS else physics


def _spawn(kind: Kind, object_set: ObjectSet, split: Split, rng: np.random.Generator, settings: LabelSettings) -> Scene:
    physics = _physics(kind, settings.physics)
    for number in range(1, MAX_EMPTY_SCENES + 1):
        try:
            scene = spawn_scene(kind, object_set, split, rng, settings.object_count, physics, settings.wide)
        except NothingFitsError:
            if number == MAX_EMPTY_SCENES:
                raise
            continue
        if scene.objects:
            return scene
    raise InputError(
        f"object set {object_set.name!r}: no object of {MAX_EMPTY_SCENES} {kind} scenes stayed in the workspace"
    )


def _recipe_objects(scene: Scene, object_set: ObjectSet) -> tuple[RecipeObject, ...]:
    return tuple(
        RecipeObject(
            placed.name,
            object_set.class_name(placed.name),
            float(np.float32(placed.scale)),
            placed.T_world_object[:3, 3].astype(np.float32),
            matrix_to_quaternion(placed.T_world_object[:3, :3]).astype(np.float32),
            placed.stretch,
        )
        for placed in scene.objects
    )

"""Training samples from recipes: every visit sees a scene through a new camera and another sensor.

Sample k of a run is a function of the run's seed and of k only, so any number of workers and any number of
interruptions give the same training.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from scipy.spatial import KDTree
from torch.utils.data import Dataset, Sampler

from icgnet.datagen.recipe import LabelHeader, Recipe, read_label_header, read_recipes
from icgnet.errors import DataError
from icgnet.geometry.cells import WORKSPACE_CELLS, CellGrid, cube_of_cells
from icgnet.geometry.transforms import make_transform, transform_points, transform_vectors, yaw_about
from icgnet.geometry.visibility import visibility_grid
from icgnet.geometry.workspace import CENTRE
from icgnet.network.config import NETWORKS, NetworkConfig
from icgnet.network.hand_input import HandInput
from icgnet.network.inputs import make_scene_input
from icgnet.objects.classes import known_class
from icgnet.objects.kinds import WIDE_KINDS
from icgnet.objects.object_set import ObjectSet
from icgnet.training.config import Sampling
from icgnet.training.observation import observe, take_crop, take_picture
from icgnet.training.placements import Placement, load_assets, occupancy_points, occupancy_points_in_crop
from icgnet.training.sample import NOTHING, Sample, choose_contacts, majority, renumber

FEWEST_POINTS = 50
"""A view with fewer points on the objects is drawn again."""
VIEWS_TRIED = 4
"""Views of a scene that are drawn before it is given up."""
MOST_EMPTY = 100
"""So many scenes in a row without anything to see are an error."""
SEEN_DISTANCE = 0.004
CROP_SHIFT = 0.1
"""Largest distance along x and y of an object from the middle of the part of a wide scene that is drawn for it [m]."""


def gather_recipes(folders: Sequence[Path], any_hand: bool = False) -> tuple[list[Recipe], LabelHeader]:
    """All recipes of some folders, and what the labels of all of them, or of the first folder's, are about.

    Args:
        folders: that `icgnet generate` wrote.
        any_hand: whether labels of several hands may be mixed, for a network that is told which each is of.

    Raises:
        DataError: a folder is not readable, or its labels are of another hand, where these may not be mixed, or of
            other classes than those of the first.
    """
    if not folders:
        raise DataError("no folders of recipes are given")
    headers = [read_label_header(Path(folder)) for folder in folders]
    for folder, header in zip(folders, headers, strict=True):
        differences = header.differences(replace(headers[0], gripper=header.gripper) if any_hand else headers[0])
        if differences:
            raise DataError(f"{folder} cannot be mixed with {folders[0]}: it has {'; '.join(differences)}")
    return [recipe for folder in folders for recipe in read_recipes(folder)], headers[0]


def network_for(preset: str, header: LabelHeader) -> NetworkConfig:
    """A preset for the hand and the classes of some labels."""
    return replace(NETWORKS[preset], gripper=header.gripper, classes=header.classes)


class RecipeDataset(Dataset):
    """Samples by number of the visit; in each epoch every recipe comes once, in another order."""

    def __init__(
        self,
        recipes: Sequence[Recipe],
        object_sets: dict[str, ObjectSet],
        sampling: Sampling,
        network: NetworkConfig,
        seed: int,
    ) -> None:
        """Loads all objects that the recipes name.

        Raises:
            InputError: the network does not know the class of an object, and has no class "other".
            DataError: a recipe names an object set that is not given, or an object that is not in it.
        """
        if not recipes:
            raise DataError("no recipes to train on")
        self.recipes, self.sampling, self.network, self.seed = list(recipes), sampling, network, seed
        self.assets = load_assets(recipes, object_sets)
        for assets in self.assets.values():
            known_class(assets.class_name, network.classes)

    def __len__(self) -> int:
        return len(self.recipes)

    def __getitem__(self, visit: int) -> Sample:
        """The sample of a visit, 0 or any larger number.

        Raises:
            DataError: neither this scene nor any of those that come next shows anything.
        """
        for later in range(MOST_EMPTY):
            # A scene without anything to see (all objects gone) gives way to the one that comes next.
            sample = self.look(visit, later)
            if sample is not None:
                return sample
        raise DataError(f"nothing can be seen in {MOST_EMPTY} scenes in a row, from visit {visit} on: are they empty?")

    def look(self, visit: int, later: int = 0) -> Sample | None:
        """The sample of a visit at its own scene, or at one that comes `later`; None if nothing is seen there."""
        recipe = self.recipes[self.scene_of(visit + later)]
        for attempt in range(VIEWS_TRIED * later, VIEWS_TRIED * (later + 1)):
            sample = self._sample(recipe, np.random.default_rng([self.seed, visit, attempt]))
            if sample is not None:
                return sample
        return None

    def scene_of(self, visit: int) -> int:
        """Index of the recipe that a visit looks at."""
        epoch, position = divmod(visit, len(self.recipes))
        return int(_epoch_order(self.seed, epoch, len(self.recipes))[position])

    def _sample(self, recipe: Recipe, rng: np.random.Generator) -> Sample | None:
        """One view of a scene with its answers, or None when too little of it is seen."""
        placements = self._placements(recipe)
        if not placements:
            return None
        if recipe.kind in WIDE_KINDS:
            region = cube_of_cells(self.sampling.crop)
            T_work_world = self._crop(placements, rng)
            views = self.sampling.table_views if recipe.kind == "table" else self.sampling.bin_views
            picture = take_crop(placements, recipe.surroundings, views, T_work_world, region, self.sampling, rng)
        else:
            region = WORKSPACE_CELLS
            picture = take_picture(placements, self.sampling, rng)
            T_work_world = self._augmentation(rng)
        seen = observe(picture.seen_from(T_work_world), self.sampling, rng)
        inside = region.holds(seen.points)
        if inside.sum() < FEWEST_POINTS:
            return None
        points, owners, viewpoint = seen.points[inside], seen.owners[inside], seen.viewpoint
        known = rng.random() >= self.sampling.viewpoint_drop
        visibility = visibility_grid(points, viewpoint, region) if known and self.network.visibility else None
        eye = viewpoint if known else None
        scene_input, point_to_voxel = make_scene_input(points, self.network, visibility, eye, region)
        voxel_owners = majority(owners, point_to_voxel, len(scene_input.voxels), len(placements))
        voxel_instances, instance_of_object = renumber(
            voxel_owners, len(placements), self.sampling.fewest_voxels, self.network.most_instances
        )
        instances = [each for each, number in zip(placements, instance_of_object, strict=True) if number >= 0]
        if not instances:
            return None
        if recipe.kind in WIDE_KINDS:
            world_points = occupancy_points_in_crop(placements, self.sampling, T_work_world, region, rng)
        else:
            world_points = occupancy_points(placements, self.sampling, T_work_world, rng)
        work_points = transform_points(T_work_world, world_points)
        distances = np.stack([each.distance(world_points) for each in instances])
        # What another hand can grasp says nothing about the one that a published network knows.
        if not self.network.any_hand and not recipe.gripper.same_hand(self.network.gripper):
            instance_of_object = np.full_like(instance_of_object, NOTHING)
        contacts = _draw_contacts(
            recipe, instance_of_object, T_work_world, region, points, viewpoint, self.sampling, rng
        )
        return Sample(
            input=scene_input,
            voxel_instances=torch.from_numpy(voxel_instances),
            classes=torch.tensor([self._class_index(each) for each in instances]),
            occupancy_points=_tensor(work_points),
            occupancy=torch.from_numpy(distances < 0),
            occupancy_asked=torch.from_numpy(nearest_and_another(distances, rng)),
            contacts=_tensor(contacts.positions),
            normals=_tensor(contacts.normals),
            contact_instances=torch.from_numpy(contacts.instances),
            contact_seen=torch.from_numpy(contacts.seen),
            labels=_tensor(contacts.labels),
            widths=_tensor(contacts.widths),
            hand=HandInput.of(recipe.gripper, self.network.hand),
        )

    def _class_index(self, placement: Placement) -> int:
        return self.network.classes.index(known_class(placement.assets.class_name, self.network.classes))

    def _placements(self, recipe: Recipe) -> list[Placement]:
        return [
            Placement(
                self.assets[recipe.object_set, each.name],
                each.factors if recipe.kind in WIDE_KINDS else each.scale,
                each.T_world_object,
            )
            for each in recipe.scene().objects
        ]

    def _crop(self, placements: list[Placement], rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
        """T_work_world of a workspace about an object of a wide scene, turned about the vertical."""
        middle = placements[rng.integers(len(placements))].T_world_object[:2, 3] + rng.uniform(-1, 1, 2) * CROP_SHIFT
        to_centre = make_transform(np.eye(3), np.array([*(CENTRE[:2] - middle), 0.0]))
        return yaw_about(CENTRE, rng.uniform(0, 2 * np.pi) if self.sampling.turn else 0.0) @ to_centre

    def _augmentation(self, rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
        """A turn about the vertical through the workspace's centre and a small shift, as T_work_world."""
        transform = yaw_about(CENTRE, rng.uniform(0, 2 * np.pi) if self.sampling.turn else 0.0)
        transform[:2, 3] += rng.uniform(-1, 1, 2) * self.sampling.translation
        return transform


class VisitBatches(Sampler[list[int]]):
    """Numbers of the visits of one device, batch by batch, from `start` on and without end."""

    def __init__(self, start: int, batch: int, rank: int = 0, devices: int = 1) -> None:
        self.start, self.batch, self.rank, self.devices = start, batch, rank, devices

    def __iter__(self) -> Iterator[list[int]]:
        """Batches; all devices together see each visit once."""
        first = self.start + self.rank * self.batch
        while True:
            yield list(range(first, first + self.batch))
            first += self.batch * self.devices


@dataclass(frozen=True, eq=False)
class DrawnContacts:
    """Contacts of one visit in the workspace frame [m]."""

    positions: Float[np.ndarray, "g 3"]
    normals: Float[np.ndarray, "g 3"]
    instances: Int[np.ndarray, "g"]
    seen: Bool[np.ndarray, "g"]
    labels: UInt8[np.ndarray, "g a"]
    widths: Float[np.ndarray, "g"]


def _draw_contacts(
    recipe: Recipe,
    instance_of_object: Int[np.ndarray, "o"],
    T_work_world: Float[np.ndarray, "4 4"],
    region: CellGrid,
    cloud: Float[np.ndarray, "n 3"],
    viewpoint: Float[np.ndarray, "3"],
    sampling: Sampling,
    rng: np.random.Generator,
) -> DrawnContacts:
    """A balanced choice of the recipe's contacts on instances, slightly off, as perception will be."""
    positions = transform_points(T_work_world, recipe.contacts.positions.astype(np.float64))
    normals = transform_vectors(T_work_world, recipe.contacts.normals.astype(np.float64))
    labels = recipe.labels()
    instances = instance_of_object[recipe.contacts.objects]
    usable = np.flatnonzero((instances >= 0) & region.holds(positions))
    seen = is_seen(positions[usable], normals[usable], cloud, viewpoint)
    if sampling.balanced_contacts:
        chosen = choose_contacts(np.any(labels[usable], axis=1), seen, sampling.contacts, sampling.seen_share, rng)
    else:
        chosen = rng.permutation(len(usable))[: sampling.contacts]
    index, seen = usable[chosen], seen[chosen]
    tilt = np.deg2rad(sampling.normal_jitter_deg) * rng.standard_normal((len(index), 3)) / np.sqrt(2)
    normals = normals[index] + np.cross(tilt, normals[index])
    return DrawnContacts(
        positions[index] + sampling.contact_jitter * rng.standard_normal((len(index), 3)),
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        instances[index],
        seen,
        labels[index],
        recipe.contacts.widths[index],
    )


def nearest_and_another(distances: Float[np.ndarray, "i n"], rng: np.random.Generator) -> Int[np.ndarray, "n k"]:
    """For each point the instance with the least signed distance and one of the others by lot, if there are others."""
    count, points = distances.shape
    nearest = distances.argmin(axis=0)
    if count == 1:
        return nearest[:, None]
    return np.stack([nearest, (nearest + rng.integers(1, count, points)) % count], axis=1)


def is_seen(
    contacts: Float[np.ndarray, "g 3"],
    normals: Float[np.ndarray, "g 3"],
    cloud: Float[np.ndarray, "n 3"],
    viewpoint: Float[np.ndarray, "3"],
) -> Bool[np.ndarray, "g"]:
    """Which contacts face the camera and have a point of the cloud within 4 mm."""
    near = cloud[_beside(cloud, contacts)]
    distance, _ = KDTree(near, balanced_tree=False, compact_nodes=False).query(
        contacts, distance_upper_bound=SEEN_DISTANCE
    )
    facing = np.einsum("gd,gd->g", normals, viewpoint - contacts) > 0
    return np.isfinite(distance) & facing


def _beside(cloud: Float[np.ndarray, "n 3"], contacts: Float[np.ndarray, "g 3"]) -> Bool[np.ndarray, "n"]:
    """Which points lie in the 4 mm cell of a contact or beside it; no other one is within 4 mm of any."""
    both = np.floor(np.concatenate([contacts, cloud]) / SEEN_DISTANCE).astype(np.int64)
    # One cell more on either side for what is beside the outermost ones.
    both += 1 - both.min(axis=0)
    shape = tuple(both.max(axis=0) + 2)
    steps = np.indices((3, 3, 3)).reshape(3, -1).T - 1
    marked = np.zeros(shape, dtype=bool)
    marked[tuple((both[: len(contacts), None] + steps).reshape(-1, 3).T)] = True
    return marked[tuple(both[len(contacts) :].T)]


@lru_cache(maxsize=4)
def _epoch_order(seed: int, epoch: int, count: int) -> Int[np.ndarray, "count"]:
    return np.random.default_rng([seed, epoch, 1_000_003]).permutation(count)


def _tensor(values: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))

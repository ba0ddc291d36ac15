from dataclasses import replace

import numpy as np
import pytest
import torch

from icgnet.datagen.recipe import RecipeContacts, RecipeObject
from icgnet.errors import InputError
from icgnet.geometry.transforms import make_transform
from icgnet.geometry.workspace import SIZE, TABLE_HEIGHT
from icgnet.network.config import NETWORKS
from icgnet.network.hand_input import HandInput
from icgnet.sensors.config import SensorNoise
from icgnet.simulation.surroundings import BIN_WALL, Surroundings, block
from icgnet.training import observation
from icgnet.training.config import Sampling
from icgnet.training.dataset import RecipeDataset
from shape_scenes import HEADER, make_recipe

TINY = NETWORKS["tiny"]
SAMPLING = replace(Sampling(), contact_jitter=0.0, tsdf=0.0)
VISITS = range(8)


def wide_recipe(scene_id, kind):
    """The shapes of a recipe twice, 25 cm apart, in front of a wall."""
    plain = make_recipe(scene_id)
    shift = np.array([0.25, 0.0, 0.0], np.float32)
    moved = tuple(
        RecipeObject(each.name, each.class_name, each.scale, each.position + shift, each.quaternion)
        for each in plain.objects
    )
    two = {
        name: np.concatenate([getattr(plain.contacts, name)] * 2)
        for name in ("normals", "widths", "success", "collided", "disturbed")
    }
    positions = np.concatenate([plain.contacts.positions, plain.contacts.positions + shift])
    owners = np.concatenate([plain.contacts.objects, plain.contacts.objects + len(moved)])
    # Its top is in the middle of voxels, not between them.
    height = 0.0985
    at = np.array([0.2, 0.28, TABLE_HEIGHT + height / 2])
    wall = block(BIN_WALL, (0.9, 0.01, height), make_transform(np.eye(3), at))
    around = Surroundings((-0.3, -0.2, 0.8, 0.5), (wall,))
    contacts = RecipeContacts(positions=positions, objects=owners, **two)
    return replace(plain, kind=kind, objects=(*plain.objects, *moved), contacts=contacts, surroundings=around)


@pytest.fixture(scope="module")
def wide():
    return [wide_recipe(0, "table"), wide_recipe(1, "bin")]


@pytest.fixture(scope="module")
def crops(wide, shapes):
    dataset = RecipeDataset(wide, {"shapes": shapes}, SAMPLING, TINY, 0)
    return [dataset[visit] for visit in VISITS]


def inside(points, grid):
    """Whether points [m] lie in a grid, but for roundings on the way to the world and back."""
    lower, upper = points.new_tensor(grid.origin), points.new_tensor(grid.end)
    return ((points >= lower - 1e-6) & (points <= upper + 1e-6)).all()


def test_everything_of_a_crop_lies_in_it(crops):
    for sample in crops:
        grid = sample.input.grid
        assert grid.end[0] - grid.origin[0] == pytest.approx(SAMPLING.crop)
        assert grid.origin[0] + grid.end[0] == pytest.approx(SIZE)
        assert inside(sample.input.positions, grid)
        assert inside(sample.occupancy_points, grid)
        assert inside(sample.contacts, grid)
    assert sum(len(sample.contacts) for sample in crops) > 50


def test_a_wall_is_input_and_no_instance(wide, shapes, crops):
    assert sum(int((sample.voxel_instances == -1).sum()) for sample in crops) > 200
    bare = [replace(each, surroundings=replace(each.surroundings, structures=())) for each in wide]
    dataset = RecipeDataset(bare, {"shapes": shapes}, replace(SAMPLING, cameras=("phoxi",)), TINY, 0)
    walled = RecipeDataset(wide, {"shapes": shapes}, replace(SAMPLING, cameras=("phoxi",)), TINY, 0)
    without, behind = (
        sum(int((each[visit].voxel_instances == -1).sum()) for visit in VISITS) for each in (dataset, walled)
    )
    assert behind > 5 * without + 100


def test_objects_that_the_border_cuts_keep_their_instance_and_their_shape(crops):
    cut = 0
    for sample in crops:
        for instance in range(len(sample.classes)):
            own = sample.input.positions[sample.voxel_instances == instance]
            at_border = bool(((own[:, :2] < 0.004) | (own[:, :2] > SIZE - 0.004)).any())
            if at_border:
                cut += 1
                assert len(own) >= SAMPLING.fewest_voxels
        if sample.occupancy.shape[1]:
            assert sample.occupancy.any(dim=1).float().mean() > 0.6
    assert cut > 0


def test_contacts_are_on_their_instance(crops):
    for sample in crops:
        for index in torch.nonzero(sample.contact_seen)[:, 0]:
            own = sample.input.positions[sample.voxel_instances == sample.contact_instances[index]]
            assert torch.linalg.norm(own - sample.contacts[index], dim=1).min() < 0.02


def test_a_published_network_gets_masks_and_shapes_of_another_hand_but_no_contacts(wide, shapes):
    hand = replace(HEADER.gripper, finger_force=HEADER.gripper.finger_force + 1.0)
    others = [replace(each, gripper=hand) for each in wide]
    published = replace(TINY, affordance="contact")
    sample = RecipeDataset(others, {"shapes": shapes}, SAMPLING, published, 0)[0]
    assert len(sample.contacts) == len(sample.labels) == 0
    assert (sample.voxel_instances >= 0).any()
    assert sample.occupancy.any()


def test_contacts_come_with_the_hand_that_their_labels_are_of(wide, shapes):
    hand = replace(HEADER.gripper, finger_force=HEADER.gripper.finger_force + 1.0, max_opening=0.1)
    others = [replace(each, gripper=hand) for each in wide]
    own, other = (RecipeDataset(each, {"shapes": shapes}, SAMPLING, TINY, 0)[0] for each in (wide, others))
    assert len(other.contacts) > 0
    for sample, gripper in ((own, HEADER.gripper), (other, hand)):
        wanted = HandInput.of(gripper, TINY.hand)
        assert torch.equal(sample.hand.points, wanted.points)
        assert torch.equal(sample.hand.numbers, wanted.numbers)
        assert sample.hand.width_limit == wanted.width_limit
    assert not torch.equal(own.hand.points, other.hand.points)


def test_the_same_visit_gives_the_same_crop(wide, shapes, crops):
    again = RecipeDataset(wide, {"shapes": shapes}, SAMPLING, TINY, 0)[3]
    for name in ("voxel_instances", "occupancy_points", "occupancy", "contacts", "labels"):
        assert torch.equal(getattr(again, name), getattr(crops[3], name)), name
    assert torch.equal(again.input.positions, crops[3].input.positions)


def test_unknown_cameras_are_refused_by_name():
    with pytest.raises(InputError, match="unknown camera 'pinhole'; the cameras are "):
        Sampling(cameras=("pinhole",))


def test_the_picture_ends_above_the_highest_thing_and_shows_all_that_is_in_the_workspace(wide, shapes, monkeypatch):
    exact = {name: replace(camera, noise=SensorNoise()) for name, camera in observation.CAMERAS.items()}
    monkeypatch.setattr(observation, "CAMERAS", exact)
    dataset = RecipeDataset(wide, {"shapes": shapes}, SAMPLING, TINY, 0)
    pixels, clouds = {}, {}
    for headroom in (observation.HEADROOM, 1.0):
        monkeypatch.setattr(observation, "HEADROOM", headroom)
        views: list[tuple[int, int]] = []
        render = observation.SceneRenderer.render

        def watched(self, intrinsics, shape, pose, views=views, render=render):
            views.append(shape)
            return render(self, intrinsics, shape, pose)

        with monkeypatch.context() as patch:
            patch.setattr(observation.SceneRenderer, "render", watched)
            clouds[headroom] = [{tuple(each) for each in dataset[visit].input.voxels.tolist()} for visit in VISITS]
        pixels[headroom] = sum(height * width for height, width in views)
    low, high = pixels
    assert pixels[low] < 0.95 * pixels[high]
    for with_less, with_all in zip(clouds[low], clouds[high], strict=True):
        assert len(with_less ^ with_all) <= 2, "but for roundings"

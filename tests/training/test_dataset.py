from dataclasses import replace

import numpy as np
import pytest
import torch

from icgnet.errors import DataError
from icgnet.geometry.workspace import SIZE
from icgnet.network.config import NETWORKS
from icgnet.sensors.config import NOISES
from icgnet.training.config import Sampling
from icgnet.training.dataset import RecipeDataset, VisitBatches, is_seen, nearest_and_another

CLEAN = replace(Sampling().for_validation(), noise=NOISES["clean"])
TURNED = replace(CLEAN, turn=True, translation=0.02)
TINY = NETWORKS["tiny"]


def flat(sample):
    parts = {"input": sample.input, "hand": sample.hand}
    inner = {f"{name}.{key}": value for name, part in parts.items() for key, value in vars(part).items()}
    return {key: value for key, value in (inner | vars(sample)).items() if isinstance(value, torch.Tensor)}


def test_same_visit_gives_the_same_sample(make_dataset):
    first, second = (flat(make_dataset(Sampling(), TINY)[5]) for _ in range(2))
    for key, value in first.items():
        torch.testing.assert_close(value, second[key], rtol=0, atol=0, msg=key)


def test_visits_differ_and_so_do_seeds(make_dataset):
    dataset = make_dataset(Sampling(), TINY)
    assert dataset[0].input.positions.shape != dataset[4].input.positions.shape
    assert make_dataset(Sampling(), TINY, seed=1)[0].input.positions.shape != dataset[0].input.positions.shape


def test_every_epoch_sees_every_scene_once(make_dataset):
    dataset = make_dataset(Sampling(), TINY)
    orders = [[dataset.scene_of(visit) for visit in range(4 * epoch, 4 * epoch + 4)] for epoch in range(6)]
    assert all(sorted(order) == [0, 1, 2, 3] for order in orders)
    assert len({tuple(order) for order in orders}) > 1


def test_scenes_without_anything_to_see_give_way_or_are_an_error(recipes, shapes):
    empty = replace(recipes[1], objects=())
    some = RecipeDataset([empty, recipes[0]], {"shapes": shapes}, Sampling(), TINY, 0)
    assert {some.look(visit) is None for visit in (0, 1)} == {True, False}
    assert all(len(some[visit].classes) > 0 for visit in range(6))
    with pytest.raises(DataError, match="100 scenes in a row, from visit 5 on"):
        RecipeDataset([empty, empty], {"shapes": shapes}, Sampling(), TINY, 0)[5]


@pytest.mark.parametrize("sampling", [CLEAN, TURNED], ids=["as is", "turned and shifted"])
def test_contacts_lie_on_the_surface_of_their_instance(make_dataset, sampling):
    dataset = make_dataset(sampling, TINY)
    for visit in range(4):
        sample = dataset[visit]
        points, normals = sample.contacts.numpy(), sample.normals.numpy()
        # The seen voxels of the instance surround its contacts that are seen.
        for index in torch.nonzero(sample.contact_seen)[:, 0]:
            own = sample.input.positions[sample.voxel_instances == sample.contact_instances[index]].numpy()
            assert np.linalg.norm(own - points[index], axis=1).min() < 0.006
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
        assert sample.contact_seen.any()
        assert not sample.contact_seen.all()


@pytest.mark.parametrize("sampling", [CLEAN, TURNED], ids=["as is", "turned and shifted"])
def test_voxels_of_an_instance_lie_on_its_occupied_space(make_dataset, sampling):
    sample = make_dataset(replace(sampling, occupancy_points=20000), TINY)[1]
    for instance in range(len(sample.classes)):
        inside = sample.occupancy_points[sample.occupancy[instance]].numpy()
        voxels = sample.input.positions[sample.voxel_instances == instance].numpy()
        assert (voxels > inside.min(0) - 0.006).all()
        assert (voxels < inside.max(0) + 0.006).all()
    assert (sample.occupancy.sum(0) <= 1).all()
    nearest = sample.occupancy.float().argmax(0)
    inside = sample.occupancy.any(0)
    assert torch.equal(nearest[inside], sample.occupancy_asked[inside, 0])


def test_labels_turn_with_the_scene(make_dataset):
    # In these scenes a grasp succeeds exactly on walls, from above, whatever the turn.
    sample = make_dataset(TURNED, TINY)[2]
    walls = sample.normals[:, 2].abs() < 0.5
    assert (sample.labels[walls].sum(1) >= 1).all()
    assert (sample.labels[~walls] == 0).all()


def test_noise_and_jitter_stay_near_the_truth(make_dataset):
    sample = make_dataset(Sampling(), TINY)[3]
    assert (sample.input.positions >= 0).all()
    assert (sample.input.positions <= SIZE).all()
    assert len(sample.contacts) <= Sampling().contacts
    assert sample.occupancy.shape == (len(sample.classes), Sampling().occupancy_points)


def test_viewpoint_is_sometimes_unknown(make_dataset):
    known = [bool(make_dataset(replace(CLEAN, viewpoint_drop=p), TINY)[0].input.dense[2].any()) for p in (0.0, 1.0)]
    assert known == [True, False]


def test_devices_share_the_visits():
    first, second = (iter(VisitBatches(8, 2, rank, 2)) for rank in (0, 1))
    assert [next(first), next(second), next(first)] == [[8, 9], [10, 11], [12, 13]]


def test_missing_object_set_is_named(recipes):
    with pytest.raises(DataError, match="shapes"):
        RecipeDataset(recipes, {}, CLEAN, TINY, 0)


def test_no_recipes_are_an_error(shapes):
    with pytest.raises(DataError, match="no recipes"):
        RecipeDataset([], {"shapes": shapes}, CLEAN, TINY, 0)


def test_a_point_is_asked_of_the_nearest_instance_and_of_another():
    distances = np.array([[0.1, -0.1, 0.3], [0.2, 0.1, 0.1], [0.3, 0.2, 0.2]]).repeat(50, axis=1)
    asked = nearest_and_another(distances, np.random.default_rng(0))
    assert np.array_equal(asked[:, 0], np.repeat([0, 0, 1], 50))
    assert (asked[:, 0] != asked[:, 1]).all()
    assert {tuple(pair) for pair in asked} == {(0, 1), (0, 2), (1, 0), (1, 2)}
    assert nearest_and_another(distances[:1], np.random.default_rng(0)).shape == (150, 1)


def test_contacts_are_seen_where_a_point_is_within_4_mm():
    rng = np.random.default_rng(0)
    cloud = np.concatenate([rng.uniform(0.0, SIZE, (3000, 3)), rng.choice([0.0, SIZE], (20, 3))])
    contacts = np.concatenate([rng.uniform(0.0, SIZE, (400, 3)), cloud[-20:], cloud[:400] + 0.0022])
    contacts = np.clip(contacts, 0.0, SIZE)
    normals = np.tile([0.0, 0.0, 1.0], (len(contacts), 1))
    seen = is_seen(contacts, normals, cloud, np.array([0.15, 0.15, 1.0]))
    distances = np.linalg.norm(contacts[:, None] - cloud[None], axis=2).min(axis=1)
    np.testing.assert_array_equal(seen, distances < 0.004)
    assert 0.1 < seen.mean() < 0.9
    assert len(is_seen(contacts[:0], normals[:0], cloud, np.array([0.15, 0.15, 1.0]))) == 0

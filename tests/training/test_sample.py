import numpy as np
import pytest

from icgnet.training.sample import choose_contacts, majority, renumber


def test_voxel_belongs_to_most_of_its_points():
    owners = np.array([0, 0, 1, 1, 1, -2, -1, 0])
    voxel_of_point = np.array([0, 0, 0, 1, 1, 2, 2, 2])
    # Voxel 2 has table, a flying pixel and one point of object 0: nobody has the majority.
    np.testing.assert_array_equal(majority(owners, voxel_of_point, 3, 2), [0, 1, -1])


def test_small_objects_are_no_instances_and_numbers_have_no_gaps():
    voxel_owners = np.repeat([0, 1, 2, -1], [12, 3, 20, 5])
    instances, of_object = renumber(voxel_owners, count=4, fewest=10, most=32)
    np.testing.assert_array_equal(of_object, [0, -1, 1, -1])
    np.testing.assert_array_equal(instances, np.repeat([0, -1, 1, -1], [12, 3, 20, 5]))


def test_largest_objects_stay_when_there_are_more_than_queries():
    voxel_owners = np.repeat([0, 1, 2], [12, 30, 20])
    _, of_object = renumber(voxel_owners, count=3, fewest=10, most=2)
    np.testing.assert_array_equal(of_object, [-1, 0, 1])


@pytest.mark.parametrize(("successes", "expected"), [(60, 20), (8, 8), (0, 0), (195, 35)])
def test_half_of_the_contacts_succeed_where_there_are_enough(successes, expected):
    rng = np.random.default_rng(0)
    successful = rng.permutation(np.arange(200) < successes)
    chosen = choose_contacts(successful, np.ones(200, bool), 40, 0.75, rng)
    assert len(chosen) == len(set(chosen.tolist())) == 40
    assert successful[chosen].sum() == expected


def test_few_contacts_are_all_taken():
    rng = np.random.default_rng(0)
    chosen = choose_contacts(rng.random(10) < 0.5, rng.random(10) < 0.5, 40, 0.75, rng)
    assert sorted(chosen) == list(range(10))


def test_seen_contacts_are_preferred():
    rng = np.random.default_rng(0)
    seen = rng.random(2000) < 0.4
    nothing = np.zeros(2000, bool)
    assert seen[choose_contacts(nothing, seen, 100, 0.75, rng)].mean() > 0.55
    assert seen[choose_contacts(nothing, seen, 100, 0.5, rng)].mean() == pytest.approx(0.4, abs=0.12)


def test_no_contacts_give_no_choice():
    nothing = np.zeros(0, bool)
    assert len(choose_contacts(nothing, nothing, 10, 0.75, np.random.default_rng(0))) == 0

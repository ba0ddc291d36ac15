import torch

from icgnet.network.instances import select_instances
from icgnet.network.refinement import StageOutput


def stage(masks, objectness, sharpness=8.0):
    """A stage whose queries claim the given voxels; class 0 has all of a query's probability of being an object."""
    mask_logits = torch.where(torch.tensor(masks, dtype=torch.bool).T, sharpness, -sharpness)
    chance = torch.tensor(objectness)
    class_logits = torch.full((len(masks), 8), -30.0)
    class_logits[:, 0], class_logits[:, -1] = chance.log(), (1 - chance).log()
    return StageOutput(torch.zeros(len(masks), 4), mask_logits, class_logits, None)


def spans(*ranges, voxels=100):
    return [[first <= voxel < last for voxel in range(voxels)] for first, last in ranges]


def test_of_many_queries_on_an_object_the_surest_stays():
    found = select_instances(stage(spans((0, 40), (0, 42), (50, 90), (52, 90)), [0.7, 0.9, 0.8, 0.6]))
    assert found.queries.tolist() == [1, 2]
    assert found.masks.sum(1).tolist() == [42, 40]
    torch.testing.assert_close(found.scores, torch.tensor([0.9, 0.8]), atol=1e-3, rtol=0)


def test_part_of_an_object_is_not_another_object():
    found = select_instances(stage(spans((0, 60), (0, 15)), [0.9, 0.8]))
    assert found.queries.tolist() == [0]


def test_queries_that_are_no_object_find_nothing():
    found = select_instances(stage(spans((0, 40), (50, 90)), [0.3, 0.9]))
    assert found.queries.tolist() == [1]
    nothing = select_instances(stage(spans((0, 40)), [0.1]))
    assert nothing.queries.shape == (0,)
    assert nothing.masks.shape == (0, 100)


def test_specks_are_no_instances():
    assert len(select_instances(stage(spans((0, 4)), [0.9])).queries) == 0


def test_no_voxel_belongs_to_two():
    found = select_instances(stage(spans((0, 50), (45, 95)), [0.9, 0.8]))
    assert len(found.queries) == 2
    assert found.masks.sum(0).max() == 1

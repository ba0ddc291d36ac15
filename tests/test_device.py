"""The predictor's tensors are made on the device of its network, shown without a second device."""

import sys

import numpy as np
import pytest
import torch

from icgnet.errors import InputError
from icgnet.inference.grasp_search import GraspSearch
from icgnet.predictor import Predictor
from tabletop_scenes import INTRINSICS, THREE_BOXES, camera_pose, depth_image, tiny_network

BORDERS = ("icgnet.inference.", "icgnet.network.inputs", "icgnet.network.surface")


class Unmoved(torch.Tensor):
    """A tensor made of an array of the host: it must be moved to the device before anything is computed with it."""

    @classmethod
    def __torch_function__(cls, function, types, args=(), kwargs=None):
        result = super().__torch_function__(function, types, args, kwargs or {})
        if function is torch.Tensor.to:
            return result.as_subclass(torch.Tensor)
        name = getattr(function, "__name__", str(function))
        assert name in ("__get__", "__len__", "split", "size", "dim", "new_zeros"), f"{name} of a tensor on the host"
        return result


@pytest.fixture
def strict(monkeypatch):
    """Tensors made of arrays must be moved, and tensors made without a device are on one that cannot compute."""
    from_numpy = torch.from_numpy

    def watched(array):
        caller = sys._getframe(1).f_globals["__name__"]
        tensor = from_numpy(array)
        return tensor.as_subclass(Unmoved) if caller.startswith(BORDERS) else tensor

    monkeypatch.setattr(torch, "from_numpy", watched)
    return torch.device("meta")


def test_every_tensor_is_made_on_or_moved_to_the_device_of_the_network(strict):
    predictor = Predictor(tiny_network(), search=GraspSearch(contacts=32, max_checked=40, min_score=0.0))
    depth = depth_image(THREE_BOXES, camera_pose())
    with strict:
        result = predictor.predict_depth(depth, INTRINSICS)
        meshes = [item.mesh() for item in result.objects]
    assert len(result.objects) > 0
    assert len(meshes) == len(result.objects)
    assert np.isfinite(result.grasps.poses).all()


def test_the_device_of_a_predictor_stays_with_other_settings():
    predictor = Predictor(tiny_network(), device="cpu", precision="bfloat16").with_search(min_score=0.3)
    assert predictor.network.device == torch.device("cpu")
    assert predictor.in_bfloat16


def test_other_devices_and_precisions_are_refused():
    with pytest.raises(InputError, match="device 'moon' cannot be used"):
        Predictor(tiny_network(), device="moon")
    with pytest.raises(InputError, match="precision must be one of auto, float32, bfloat16, got 'half'"):
        Predictor(tiny_network(), precision="half")


def test_sixteen_bits_change_scores_a_little():
    depth = depth_image(THREE_BOXES, camera_pose())
    search = GraspSearch(contacts=32, max_checked=40, min_score=0.0)
    full, short = (
        Predictor(tiny_network(), search=search, precision=precision).predict_depth(depth, INTRINSICS)
        for precision in ("float32", "bfloat16")
    )
    assert len(full.objects) > 0
    assert [item.score for item in full.objects] != [item.score for item in short.objects]
    assert full.objects[0].score == pytest.approx(short.objects[0].score, abs=0.1)

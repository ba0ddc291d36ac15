import numpy as np
import pytest
import torch

from icgnet.errors import InputError
from icgnet.network.surface import extract_mesh

LOWER, UPPER = np.array([0.05, 0.04, 0.06]), np.array([0.15, 0.16, 0.14])
RADIUS = 0.03


class Sphere:
    """Occupancy logits of a sphere that remembers how many points it was asked for."""

    def __init__(self) -> None:
        self.asked = 0

    def __call__(self, points: torch.Tensor) -> torch.Tensor:
        self.asked += len(points)
        return 200.0 * (RADIUS - (points - torch.tensor([0.1, 0.1, 0.1])).norm(dim=1))


def test_sphere_has_its_volume_place_and_a_closed_surface():
    mesh = extract_mesh(Sphere(), LOWER, UPPER, 48)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.03)
    np.testing.assert_allclose(mesh.bounds, [[0.07] * 3, [0.13] * 3], atol=3e-4)


def test_refined_mesh_equals_the_mesh_of_the_whole_grid_with_fewer_evaluations():
    sphere = Sphere()
    fine = extract_mesh(sphere, LOWER, UPPER, 64)
    assert sphere.asked < 0.35 * 65 * 65 * 65
    distance = np.linalg.norm(fine.vertices - 0.1, axis=1)
    np.testing.assert_allclose(distance, RADIUS, atol=5e-5)


def test_shape_at_the_border_of_the_box_is_closed():
    mesh = extract_mesh(Sphere(), np.array([0.1, 0.05, 0.05]), np.array([0.15, 0.15, 0.15]), 32)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(2 / 3 * np.pi * RADIUS**3, rel=0.05)


def test_nothing_inside_gives_an_empty_mesh():
    assert extract_mesh(lambda points: -torch.ones(len(points)), LOWER, UPPER, 32).is_empty


def test_a_thin_plate_is_found_where_it_was_seen():
    def plate(points: torch.Tensor) -> torch.Tensor:
        offsets = (points - torch.tensor([0.0, 0.0, 0.006])).abs() - torch.tensor([0.04, 0.03, 0.002])
        return -100.0 * offsets.amax(1)

    lower, upper = np.array([-0.06, -0.06, -0.02]), np.array([0.06, 0.06, 0.03])
    axis = np.linspace(-0.025, 0.025, 12)
    seen = np.stack([*map(np.ravel, np.meshgrid(axis, axis)), np.full(144, 0.008)], axis=1)
    assert len(extract_mesh(plate, lower, upper, 64).faces) == 0
    mesh = extract_mesh(plate, lower, upper, 64, seen)
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.extents, [0.08, 0.06, 0.004], atol=0.002)


def test_no_box_is_an_input_error():
    with pytest.raises(InputError, match="no box"):
        extract_mesh(Sphere(), UPPER, LOWER, 32)

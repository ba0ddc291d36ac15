from pathlib import Path

import numpy as np
import pytest
import trimesh

from icgnet.geometry.signed_distance import (
    PADDING,
    PITCH,
    SignedDistanceGrid,
    build_signed_distance_grid,
    cached_signed_distance_grid,
)

HALF = np.array([0.02, 0.03, 0.025])


def box_distance(points: np.ndarray, half: np.ndarray) -> np.ndarray:
    excess = np.abs(points) - half
    return np.linalg.norm(np.maximum(excess, 0.0), axis=1) + np.minimum(excess.max(axis=1), 0.0)


def pipe_distance(points: np.ndarray) -> np.ndarray:
    radius = np.linalg.norm(points[:, :2], axis=1)
    excess = np.column_stack([np.abs(radius - 0.025) - 0.005, np.abs(points[:, 2]) - 0.03])
    return np.linalg.norm(np.maximum(excess, 0.0), axis=1) + np.minimum(excess.max(axis=1), 0.0)


SHAPES = {
    "sphere": (
        trimesh.creation.icosphere(subdivisions=4, radius=0.03),
        lambda p: np.linalg.norm(p, axis=1) - 0.03,
    ),
    "box": (trimesh.creation.box(2.0 * HALF), lambda p: box_distance(p, HALF)),
    "pipe": (trimesh.creation.annulus(0.02, 0.03, 0.06, sections=96), pipe_distance),
}


@pytest.fixture(scope="module")
def grids() -> dict[str, SignedDistanceGrid]:
    return {name: build_signed_distance_grid(mesh) for name, (mesh, _) in SHAPES.items()}


def random_points(mesh: trimesh.Trimesh, count: int = 20_000) -> np.ndarray:
    return np.random.default_rng(0).uniform(mesh.bounds[0] - 0.004, mesh.bounds[1] + 0.004, (count, 3))


@pytest.mark.parametrize("name", SHAPES)
def test_inside_agrees_with_the_analytic_shape_at_995_of_1000_points(name, grids):
    mesh, distance = SHAPES[name]
    points = random_points(mesh)
    agree = (grids[name].distance(points) < 0.0) == (distance(points) < 0.0)
    assert agree.mean() >= 0.995


@pytest.mark.parametrize("name", SHAPES)
def test_distance_is_within_a_fraction_of_the_pitch(name, grids):
    mesh, distance = SHAPES[name]
    points = random_points(mesh)
    error = np.abs(grids[name].distance(points) - distance(points))
    assert error.mean() < 0.1 * PITCH
    assert error.max() < PITCH


def test_bore_of_a_pipe_is_outside(grids):
    on_axis = np.column_stack([np.zeros(20), np.zeros(20), np.linspace(-0.035, 0.035, 20)])
    assert (grids["pipe"].distance(on_axis) > 0.015).all()


def test_overlapping_closed_pieces_are_a_union():
    shift = np.array([0.02, 0.03, 0.01])
    second = trimesh.creation.box(2.0 * HALF).apply_translation(shift)
    both = trimesh.util.concatenate([trimesh.creation.box(2.0 * HALF), second])
    grid = build_signed_distance_grid(both)
    points = random_points(both)
    expected = np.minimum(box_distance(points, HALF), box_distance(points - shift, HALF))
    distance = grid.distance(points)
    assert ((distance < 0.0) == (expected < 0.0)).mean() >= 0.995
    deep_in_overlap = 0.5 * shift[None]
    assert grid.distance(deep_in_overlap)[0] < 0.5 * box_distance(deep_in_overlap, HALF)[0]
    outside = expected > 0.0
    assert np.abs(distance - expected)[outside].max() < PITCH


def test_winding_of_the_faces_does_not_matter(grids):
    inverted = SHAPES["box"][0].copy()
    inverted.invert()
    np.testing.assert_array_equal(build_signed_distance_grid(inverted).values, grids["box"].values)


def test_box_with_a_small_hole_is_still_solid():
    mesh = trimesh.creation.box(2.0 * HALF).subdivide().subdivide().subdivide()
    broken = trimesh.Trimesh(mesh.vertices, mesh.faces[10:], process=False)
    assert not broken.is_watertight
    points = random_points(mesh)
    agree = (build_signed_distance_grid(broken).distance(points) < 0.0) == (box_distance(points, HALF) < 0.0)
    assert agree.mean() >= 0.995


def test_far_away_the_distance_is_a_positive_lower_bound(grids):
    points = np.random.default_rng(1).uniform(-0.3, 0.3, (5000, 3))
    far = (np.abs(points) - HALF).max(axis=1) > 0.02
    distance, expected = grids["box"].distance(points[far]), box_distance(points[far], HALF)
    assert (distance >= PADDING).all()
    assert (distance <= expected + 1e-4).all()
    assert (distance >= 0.7 * expected).all()


def test_saved_grid_is_read_back_unchanged(tmp_path: Path, grids):
    grids["box"].save(tmp_path / "grid.npz")
    loaded = SignedDistanceGrid.load(tmp_path / "grid.npz")
    np.testing.assert_array_equal(loaded.values, grids["box"].values)
    np.testing.assert_array_equal(loaded.origin, grids["box"].origin)
    assert loaded.pitch == grids["box"].pitch
    assert [path.name for path in tmp_path.iterdir()] == ["grid.npz"]


def test_cached_grid_is_not_built_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    mesh = trimesh.creation.box([0.01, 0.01, 0.01])
    first = cached_signed_distance_grid(mesh, tmp_path)
    monkeypatch.setattr("icgnet.geometry.signed_distance.build_signed_distance_grid", None)
    np.testing.assert_array_equal(cached_signed_distance_grid(mesh, tmp_path).values, first.values)


@pytest.mark.parametrize("content", [b"", b"not a zip file", b"PK\x03\x04 truncated"])
def test_damaged_cache_file_is_replaced(tmp_path: Path, content: bytes):
    mesh = trimesh.creation.box([0.01, 0.01, 0.01])
    grid = cached_signed_distance_grid(mesh, tmp_path)
    (path,) = tmp_path.iterdir()
    path.write_bytes(content)
    np.testing.assert_array_equal(cached_signed_distance_grid(mesh, tmp_path).values, grid.values)
    assert SignedDistanceGrid.load(path).values.shape == grid.values.shape


def test_changed_mesh_gets_a_new_grid(tmp_path: Path):
    cached_signed_distance_grid(trimesh.creation.box([0.01, 0.01, 0.01]), tmp_path)
    cached_signed_distance_grid(trimesh.creation.box([0.01, 0.01, 0.02]), tmp_path)
    assert len(list(tmp_path.iterdir())) == 2

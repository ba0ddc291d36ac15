from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

from icgnet.geometry.signed_distance import (
    FINEST_PITCH,
    PADDING,
    PITCH,
    SignedDistanceGrid,
    build_signed_distance_grid,
    cached_signed_distance_grid,
    choose_pitch,
    wall_thickness,
)
from icgnet.geometry.transforms import make_transform, quaternion_to_matrix, transform_points

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


def revolved(profile: list[tuple[float, float]]) -> trimesh.Trimesh:
    """A closed profile of (radius, height) points, turned about z."""
    return trimesh.creation.revolve(np.array(profile), sections=96)


def cup(radius: float, height: float, wall: float) -> trimesh.Trimesh:
    inner = radius - wall
    return revolved([(0, 0), (radius, 0), (radius, height), (inner, height), (inner, wall), (0, wall)])


def inside_cup(points: np.ndarray, radius: float, height: float, wall: float) -> np.ndarray:
    r, z = np.linalg.norm(points[:, :2], axis=1), points[:, 2]
    return (r < radius) & (z > 0) & (z < height) & ((r > radius - wall) | (z < wall))


def bowl(radius: float, wall: float) -> trimesh.Trimesh:
    down = np.linspace(-np.pi / 2, 0.0, 65)
    outer = [(radius * np.cos(a), radius * np.sin(a)) for a in down]
    inner = [((radius - wall) * np.cos(a), (radius - wall) * np.sin(a)) for a in down[::-1]]
    return revolved([*outer, *inner])


def inside_bowl(points: np.ndarray, radius: float, wall: float) -> np.ndarray:
    r = np.linalg.norm(points, axis=1)
    return (r < radius) & (r > radius - wall) & (points[:, 2] < 0)


def inside_torus(points: np.ndarray) -> np.ndarray:
    from_ring = np.linalg.norm(points[:, :2], axis=1) - 0.03
    return np.hypot(from_ring, points[:, 2]) < 0.01


SOLIDS = {
    "box": (SHAPES["box"][0], lambda p: (np.abs(p) < HALF).all(axis=1)),
    "sphere": (SHAPES["sphere"][0], lambda p: np.linalg.norm(p, axis=1) < 0.03),
    "cylinder": (
        trimesh.creation.cylinder(0.025, 0.07, sections=96),
        lambda p: (np.linalg.norm(p[:, :2], axis=1) < 0.025) & (np.abs(p[:, 2]) < 0.035),
    ),
    "torus": (trimesh.creation.torus(0.03, 0.01, major_sections=128, minor_sections=64), inside_torus),
    "cup, wall 3 mm": (cup(0.03, 0.05, 0.003), lambda p: inside_cup(p, 0.03, 0.05, 0.003)),
    "cup, wall 1 mm": (cup(0.02, 0.04, 0.001), lambda p: inside_cup(p, 0.02, 0.04, 0.001)),
    "bowl, wall 2 mm": (bowl(0.04, 0.002), lambda p: inside_bowl(p, 0.04, 0.002)),
    "cup and a ring through its wall": (
        trimesh.util.concatenate(
            [
                cup(0.03, 0.05, 0.003),
                trimesh.creation.torus(0.03, 0.01, 128, 64).apply_translation([0.03, 0.0, 0.025]),
            ]
        ),
        lambda p: inside_cup(p, 0.03, 0.05, 0.003) | inside_torus(p - [0.03, 0.0, 0.025]),
    ),
}
"""Mesh, and the exact answer to which points are inside."""


@cache
def grid_of(name: str) -> SignedDistanceGrid:
    mesh = SOLIDS[name][0]
    return build_signed_distance_grid(mesh, choose_pitch(mesh))


@pytest.mark.parametrize("name", SOLIDS)
def test_occupancy_agrees_with_the_exact_answer_and_errs_only_at_the_surface(name):
    mesh, is_inside = SOLIDS[name]
    grid, points = grid_of(name), random_points(mesh, 40_000)
    distance, expected = grid.distance(points), is_inside(points)
    wrong = (distance < 0.0) != expected
    near = np.abs(distance) < 0.5 * grid.pitch
    assert wrong.mean() <= 0.005
    assert not wrong[~near].any()
    assert wrong[near].mean() <= 0.10
    # As many points are called inside as are inside, to 3 %: thin walls neither swell nor vanish.
    assert (distance < 0.0).sum() == pytest.approx(expected.sum(), rel=0.03)


@pytest.mark.parametrize(("name", "radius", "wall"), [("cup, wall 3 mm", 0.03, 0.003), ("cup, wall 1 mm", 0.02, 0.001)])
def test_cavity_of_a_cup_is_free_and_its_wall_is_not(name, radius, wall):
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    middle = radius - wall / 2
    in_wall = np.column_stack([middle * np.cos(angle), middle * np.sin(angle), np.full(100, 0.0213)])
    assert (grid_of(name).distance(in_wall) < 0.0).all()
    in_cavity = np.array([[0.0, 0.0, radius]])
    assert grid_of(name).distance(in_cavity)[0] == pytest.approx(radius - wall, abs=0.001)


def test_distance_holds_on_flat_faces_cut_into_slivers():
    disc = trimesh.creation.cylinder(0.03, 0.01, sections=96)
    assert np.linalg.norm(disc.vertices[:, :2], axis=1).min() < 1e-6  # a fan around the centre
    grid = build_signed_distance_grid(disc)
    r = np.linspace(0.0, 0.025, 200)
    above = np.column_stack([r, np.zeros(200), np.full(200, 0.0062)])
    np.testing.assert_allclose(grid.distance(above), 0.0012, atol=2e-4)


def test_wall_of_one_millimetre_is_lost_at_the_coarse_pitch():
    mesh, is_inside = SOLIDS["cup, wall 1 mm"]
    points = random_points(mesh)
    coarse = build_signed_distance_grid(mesh, PITCH).distance(points) < 0.0
    assert (coarse != is_inside(points)).mean() > 0.005


@pytest.mark.parametrize(
    ("mesh", "thickness"),
    [(cup(0.03, 0.05, 0.002), 0.002), (bowl(0.04, 0.0015), 0.0015), (SHAPES["box"][0], 0.04)],
    ids=["cup", "bowl", "box"],
)
def test_wall_thickness_is_measured(mesh, thickness):
    assert wall_thickness(mesh) == pytest.approx(thickness, rel=0.05)


def test_a_sheet_encloses_nothing_and_gets_the_coarse_pitch():
    sheet = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]], process=False)
    assert wall_thickness(sheet) == np.inf
    assert choose_pitch(sheet) == PITCH


def test_solid_things_get_the_coarse_pitch_and_thin_ones_a_finer_one():
    assert choose_pitch(SHAPES["box"][0]) == PITCH
    assert FINEST_PITCH <= choose_pitch(SOLIDS["cup, wall 1 mm"][0]) < PITCH
    huge_and_thin = cup(0.3, 0.6, 0.001)
    assert choose_pitch(huge_and_thin) == PITCH


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


def test_one_grid_serves_all_scales_and_places(grids):
    T_world_object = make_transform(quaternion_to_matrix(np.array([0.8, 0.0, 0.6, 0.0])), np.array([0.4, -0.2, 0.1]))
    points = random_points(SHAPES["box"][0], 2000)
    distance = grids["box"].distance_from(transform_points(T_world_object, 1.5 * points), T_world_object, 1.5)
    np.testing.assert_allclose(distance, 1.5 * grids["box"].distance(points), atol=1e-9)


@pytest.mark.parametrize("name", SHAPES)
def test_a_stretched_object_is_measured_as_by_its_own_grid(name, grids):
    factors, stretch = np.array([1.2, 1.2, 1.2]), 1.15
    factors[{"sphere": 0, "box": 1, "pipe": 2}[name]] *= stretch
    mesh, _ = SHAPES[name]
    rebuilt = build_signed_distance_grid(trimesh.Trimesh(factors * mesh.vertices, mesh.faces, process=False))
    T_world_object = make_transform(quaternion_to_matrix(np.array([0.6, 0.0, 0.0, 0.8])), np.array([0.1, 0.2, 0.3]))
    points = factors * random_points(mesh)
    told = grids[name].distance_from(transform_points(T_world_object, points), T_world_object, factors)
    own = rebuilt.distance(points)
    clear = np.abs(own) > 0.0005
    assert ((told < 0.0) == (own < 0.0))[clear].all()
    assert ((told < 0.0) == (own < 0.0)).mean() >= 0.995
    assert (np.abs(told) <= np.abs(own) + PITCH).all()
    assert (np.abs(told) >= np.abs(own) / stretch - PITCH).all()
    assert np.mean(np.abs(told) - np.abs(own)) < 0.0


def test_three_equal_factors_are_one_bit_for_bit(grids):
    points = random_points(SHAPES["pipe"][0], 2000)
    one, three = (grids["pipe"].distance_from(points, np.eye(4), scale) for scale in (1.3, np.full(3, 1.3)))
    np.testing.assert_array_equal(one, three)
    np.testing.assert_array_equal(one, 1.3 * grids["pipe"].distance(points / 1.3))


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

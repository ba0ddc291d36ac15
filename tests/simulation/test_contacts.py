import numpy as np
import pytest
import trimesh

from icgnet.simulation.contacts import sample_contacts


def _box(*edges, centre=(0.15, 0.15, 0.15)):
    mesh = trimesh.creation.box(extents=edges)
    mesh.apply_translation(centre)
    return mesh


def _tube(outer, inner, height=0.1):
    mesh = trimesh.creation.annulus(r_min=inner, r_max=outer, height=height, sections=64)
    mesh.apply_translation([0.15, 0.15, 0.15])
    return mesh


def test_contacts_lie_on_the_surface_with_outward_normals(rng):
    mesh = _box(0.04, 0.05, 0.06)
    contacts = sample_contacts([mesh], 200, rng)
    offset = contacts.positions - [0.15, 0.15, 0.15]
    assert len(contacts) == 200
    np.testing.assert_allclose((np.abs(offset) / [0.02, 0.025, 0.03]).max(axis=1), 1.0)
    outward = (offset / [0.02, 0.025, 0.03] * contacts.normals).sum(axis=1)
    np.testing.assert_allclose(outward, 1.0)


def test_the_width_is_the_thickness_behind_the_contact(rng):
    edges = np.array([0.04, 0.05, 0.06])
    contacts = sample_contacts([_box(*edges)], 100, rng)
    np.testing.assert_allclose(contacts.widths[:, 0], np.abs(contacts.normals) @ edges, atol=1e-5)
    assert np.isinf(contacts.widths[:, 1:]).all()


def test_a_tube_has_the_width_of_its_wall_and_of_the_whole(rng):
    contacts = sample_contacts([_tube(0.03, 0.025)], 300, rng)
    radius = np.linalg.norm(contacts.positions[:, :2] - 0.15, axis=1)
    is_outside = (np.abs(contacts.normals[:, 2]) < 0.5) & (radius > 0.0275)
    assert is_outside.sum() > 50
    np.testing.assert_allclose(contacts.widths[is_outside, 0], 0.005, atol=2e-4)
    np.testing.assert_allclose(contacts.widths[is_outside, 1], 0.06, atol=2e-4)
    assert np.isinf(contacts.widths[is_outside, 2]).all()


def test_a_contact_inside_a_tube_sees_the_wall_only(rng):
    contacts = sample_contacts([_tube(0.03, 0.025)], 300, rng)
    radius = np.linalg.norm(contacts.positions[:, :2] - 0.15, axis=1)
    is_inside = (np.abs(contacts.normals[:, 2]) < 0.5) & (radius < 0.0275)
    assert is_inside.sum() > 50
    np.testing.assert_allclose(contacts.widths[is_inside, 0], 0.005, atol=2e-4)
    assert np.isinf(contacts.widths[is_inside, 1:]).all()


def test_overlapping_pieces_count_as_one_body(rng):
    pieces = trimesh.util.concatenate([_box(0.06, 0.04, 0.04), _box(0.06, 0.04, 0.04, centre=(0.18, 0.15, 0.15))])
    contacts = sample_contacts([pieces], 300, rng)
    along_x = np.abs(contacts.normals[:, 0]) > 0.5
    np.testing.assert_allclose(np.abs(contacts.positions[along_x, 0] - 0.165), 0.045, atol=1e-6)
    np.testing.assert_allclose(contacts.widths[along_x, 0], 0.09, atol=1e-5)


def test_most_contacts_are_on_walls(rng):
    contacts = sample_contacts([_box(0.08, 0.08, 0.02)], 1000, rng)
    assert np.mean(np.abs(contacts.normals[:, 2]) < 0.5) == pytest.approx(0.85, abs=0.04)


def test_contacts_keep_away_from_the_table(rng):
    contacts = sample_contacts([_box(0.05, 0.05, 0.05, centre=(0.15, 0.15, 0.075))], 300, rng)
    assert contacts.positions[:, 2].min() >= 0.055


def test_every_object_gets_its_share(rng):
    meshes = [_box(0.02, 0.02, 0.02), _box(0.1, 0.1, 0.1, centre=(0.3, 0.3, 0.3)), _tube(0.03, 0.02)]
    contacts = sample_contacts(meshes, 50, rng)
    assert sorted(np.bincount(contacts.objects)) == [16, 17, 17]


def test_an_object_below_the_table_gets_no_contacts(rng):
    meshes = [_box(0.02, 0.02, 0.02, centre=(0.1, 0.1, 0.0)), _box(0.04, 0.04, 0.04)]
    contacts = sample_contacts(meshes, 20, rng)
    assert contacts.objects.tolist() == [1] * 10


def test_contacts_turn_with_the_object(rng):
    mesh, turned = _tube(0.03, 0.02), _tube(0.03, 0.02)
    turn = trimesh.transformations.rotation_matrix(0.7, [0, 0, 1], [0.15, 0.15, 0.15])
    turned.apply_transform(turn)
    contacts = sample_contacts([mesh], 50, np.random.default_rng(1))
    rotated = sample_contacts([turned], 50, np.random.default_rng(1))
    np.testing.assert_allclose(rotated.positions, trimesh.transform_points(contacts.positions, turn), atol=1e-6)
    np.testing.assert_allclose(rotated.normals, contacts.normals @ turn[:3, :3].T, atol=1e-6)

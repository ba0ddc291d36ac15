import numpy as np
import pytest
import trimesh

from icgnet.objects.outlines import circle, rectangle
from icgnet.objects.solids import Solid, extrude, hollow_prism, loft, ring, tube, vessel


def parts_volume(solid: Solid) -> float:
    return sum(part.volume for part in solid.hulls())


def spool() -> Solid:
    return loft([ring(circle(24), radius, z) for radius, z in ((0.03, 0.0), (0.03, 0.01), (0.01, 0.012), (0.01, 0.04))])


def cup() -> Solid:
    outer = [ring(circle(32), 0.03, z) for z in (0.0, 0.08)]
    return vessel(outer, [ring(circle(32), 0.025, z) for z in (0.01, 0.08)], sectors=16)


def torus() -> Solid:
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    path = 0.03 * np.column_stack([np.cos(angle), np.zeros(24), np.sin(angle)])
    return tube(path, 0.008 * circle(12), closed=True)


def letter_l() -> Solid:
    outline = 0.05 * np.array([[0, 0], [1, 0], [1, 0.3], [0.3, 0.3], [0.3, 1], [0, 1]])
    return extrude(outline, 0.03)


def roll() -> Solid:
    return hollow_prism(0.04 * circle(28), 0.02 * circle(28), 0.03, bevel=0.001)


SOLIDS = [spool, cup, torus, letter_l, roll]


@pytest.mark.parametrize("make", SOLIDS)
def test_surface_is_closed_and_points_outward(make):
    surface = make().surface
    assert surface.is_watertight
    assert surface.is_winding_consistent
    assert surface.volume > 0.0


@pytest.mark.parametrize("make", SOLIDS)
def test_convex_pieces_hold_the_volume_of_the_surface(make):
    solid = make()
    assert parts_volume(solid) == pytest.approx(solid.surface.volume, rel=0.06)
    assert all(part.is_convex and part.is_watertight for part in solid.hulls())


def test_cup_is_hollow_for_the_physics():
    cup_parts = cup().hulls()
    centre = np.array([[0.0, 0.0, 0.05]])
    assert not any(part.contains(centre)[0] for part in cup_parts)
    wall = 0.0275 * np.array([[np.cos(0.1), np.sin(0.1), 0.0]]) + [0.0, 0.0, 0.05]
    assert any(part.contains(wall)[0] for part in cup_parts)


def test_torus_has_its_hole():
    volume = torus().surface.volume
    assert volume == pytest.approx(2.0 * np.pi**2 * 0.03 * 0.008**2, rel=0.1)
    assert not any(part.contains(np.zeros((1, 3)))[0] for part in torus().hulls())


def test_letter_l_is_cut_into_two_pieces():
    assert len(letter_l().parts) == 2


def test_straight_loft_is_one_piece():
    box = loft([ring(rectangle(0.02, 0.03), 1.0, z) for z in (0.0, 0.01, 0.05)])
    assert len(box.parts) == 1
    assert box.surface.volume == pytest.approx(0.02 * 0.03 * 0.05)


def test_moved_and_turned_solid_takes_its_pieces_along():
    solid = letter_l().turned(np.pi / 2, (0.0, 1.0, 0.0)).moved(x=0.1)
    bounds = trimesh.util.concatenate(list(solid.hulls())).bounds
    np.testing.assert_allclose(bounds, solid.surface.bounds, atol=1e-12)
    assert solid.surface.volume > 0.0

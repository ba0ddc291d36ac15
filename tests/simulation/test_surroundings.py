import numpy as np
import pytest

from icgnet.geometry.rays import ray_scene
from icgnet.geometry.transforms import make_transform, rotation_z
from icgnet.geometry.workspace import CENTRE, SIZE, TABLE_HEIGHT
from icgnet.simulation.config import WideScenes
from icgnet.simulation.furniture import FLOOR, draw_bin, draw_table
from icgnet.simulation.surroundings import BIN_WALL, ENDLESS, Structure, Surroundings, block, rod

CONFIG = WideScenes()
SEEDS = range(40)
AT = np.array([0.1, 0.2, 0.3])


@pytest.fixture(scope="module")
def tables() -> list[Surroundings]:
    return [draw_table(CONFIG, np.random.default_rng(seed)) for seed in SEEDS]


@pytest.fixture(scope="module")
def bins() -> list[Surroundings]:
    return [draw_bin(CONFIG, np.random.default_rng(seed)) for seed in SEEDS]


def size_of(surroundings):
    lower_x, lower_y, upper_x, upper_y = surroundings.extent
    assert (lower_x + upper_x) / 2 == pytest.approx(CENTRE[0])
    assert (lower_y + upper_y) / 2 == pytest.approx(CENTRE[1])
    return upper_x - lower_x, upper_y - lower_y


def walls_of(surroundings):
    return [each for each in surroundings.structures if each.name == BIN_WALL]


def inner_normal(wall):
    """Of the largest side of a bin's wall that looks to the middle of the bin."""
    mesh = wall.mesh()
    to_middle = CENTRE[:2] - mesh.centroid[:2]
    facing = mesh.face_normals[:, :2] @ (to_middle / np.linalg.norm(to_middle)) > 0.5
    return mesh.face_normals[np.flatnonzero(facing)[mesh.area_faces[facing].argmax()]]


def test_a_block_has_the_edges_asked_for_and_is_longer_along_x_at_its_top():
    corners = block("a", (0.2, 0.04, 0.1), make_transform(np.eye(3), AT), flare=1.5).corners - AT
    top = corners[:, 2] > 0
    assert sorted(set(np.round(np.abs(corners[:, 2]), 9))) == [0.05]
    np.testing.assert_allclose(np.abs(corners[top]), np.tile([0.15, 0.02, 0.05], (4, 1)))
    np.testing.assert_allclose(np.abs(corners[~top]), np.tile([0.1, 0.02, 0.05], (4, 1)))


def test_a_block_turns_with_its_frame():
    corners = block("a", (0.2, 0.04, 0.1), make_transform(rotation_z(np.pi / 2), AT)).corners
    np.testing.assert_allclose(np.ptp(corners, axis=0), [0.04, 0.2, 0.1], atol=1e-9)


def test_a_rod_has_the_diameter_and_length_asked_for():
    corners = rod("a", 0.08, 0.5, make_transform(np.eye(3), AT)).corners - AT
    np.testing.assert_allclose(np.linalg.norm(corners[:, :2], axis=1), 0.04)
    np.testing.assert_allclose(np.abs(corners[:, 2]), 0.25)


@pytest.mark.parametrize(
    ("structure", "volume"),
    [
        (block("a", (0.2, 0.04, 0.1), make_transform(rotation_z(0.3), AT)), 0.2 * 0.04 * 0.1),
        (block("a", (0.2, 0.04, 0.1), make_transform(rotation_z(0.3), AT), flare=1.5), 1.25 * 0.2 * 0.04 * 0.1),
        (rod("a", 0.08, 0.5, make_transform(rotation_z(0.3), AT)), 10 * 0.04**2 * np.sin(np.pi / 10) * 0.5),
    ],
    ids=["block", "flare", "rod"],
)
def test_surfaces_are_closed_and_look_outwards(structure, volume):
    mesh = structure.mesh()
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(volume, rel=1e-5)
    outwards = mesh.triangles_center - mesh.centroid
    assert ((outwards * mesh.face_normals).sum(axis=1) > 0).all()


def test_bounds_are_those_of_the_cube_the_table_or_the_outside_of_the_bins_walls(tables, bins):
    np.testing.assert_array_equal(ENDLESS.bounds, [[0.0, 0.0], [SIZE, SIZE]])
    np.testing.assert_array_equal(np.concatenate(tables[0].bounds), tables[0].extent)
    post = Structure("post", np.array([[9.0, 9.0, 9.0]]))
    wall = Structure(BIN_WALL, np.array([[-1.0, -2.0, 0.0], [3.0, 4.0, 0.0]]))
    np.testing.assert_array_equal(Surroundings((0.0, 0.0, 1.0, 1.0), (wall, post)).bounds, [[-1.0, -2.0], [3.0, 4.0]])
    for each in bins:
        lower, upper = each.bounds
        assert (lower < np.array(each.extent[:2]) - 0.0029).all()
        assert (upper > np.array(each.extent[2:]) + 0.0029).all()


def test_tables_have_edges_from_the_range_and_a_body_below_their_top(tables):
    sizes = np.array([size_of(each) for each in tables])
    assert (sizes >= CONFIG.table_edge[0] - 1e-6).all()
    assert (sizes <= CONFIG.table_edge[1] + 1e-6).all()
    assert np.ptp(sizes) > 0.5
    for table in tables:
        edge = next(each for each in table.structures if each.name == "table edge").corners
        np.testing.assert_allclose(np.ptp(edge[:, :2], axis=0), size_of(table), atol=1e-6)
        assert TABLE_HEIGHT - 0.001 < edge[:, 2].max() < TABLE_HEIGHT
        floor = next(each for each in table.structures if each.name == FLOOR).corners
        assert floor[:, 2].max() < edge[:, 2].min() - 0.2


def test_bins_have_floors_and_walls_from_the_ranges(bins):
    sizes = np.array([size_of(each) for each in bins])
    assert (sizes >= CONFIG.bin_edge[0] - 1e-6).all()
    assert (sizes <= CONFIG.bin_edge[1] + 1e-6).all()
    # The top of a leaning wall is its inner edge.
    heights = np.array([walls_of(each)[0].corners[:, 2].max() for each in bins]) - TABLE_HEIGHT
    assert (heights >= CONFIG.bin_height[0] - 1e-6).all()
    assert (heights <= CONFIG.bin_height[1] + 1e-6).all()
    assert np.ptp(heights) > 0.1
    assert {len(walls_of(each)) for each in bins} == {4, 8}


def test_bin_walls_stand_upright_or_lean_outwards_as_drawn():
    config = WideScenes(bin_slope_deg=(10.0, 10.0))
    slopes = []
    for seed in range(12):
        walls = walls_of(draw_bin(config, np.random.default_rng(seed)))[:4]
        own = np.rad2deg([np.arcsin(inner_normal(wall)[2]) for wall in walls])
        np.testing.assert_allclose(own, own[0], atol=0.01)
        slopes.append(round(float(own[0]), 1))
    assert set(slopes) == {0.0, 10.0}


def test_bin_walls_begin_at_the_edge_of_the_floor(bins):
    for each in bins:
        for wall in walls_of(each)[:4]:
            normal = inner_normal(wall)
            inner_height = (wall.corners @ normal).max()
            side = np.argmax(np.abs(normal[:2]))
            foot = np.array([*CENTRE[:2], TABLE_HEIGHT])
            foot[side] = each.extent[side] if normal[side] > 0 else each.extent[2 + side]
            assert foot @ normal == pytest.approx(inner_height, abs=1e-5)


def test_nothing_rolls_out_of_a_bin(bins):
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    level = np.stack([np.cos(angle), np.sin(angle), np.zeros(720)], axis=1).astype(np.float32)
    for each in bins:
        walls = walls_of(each)
        scene = ray_scene(np.concatenate([wall.mesh().triangles for wall in walls]).astype(np.float32))
        height = walls[0].corners[:, 2].max() - TABLE_HEIGHT
        for share in (0.02, 0.5, 0.97):
            eyes = np.tile(np.array([*CENTRE[:2], TABLE_HEIGHT + share * height], np.float32), (720, 1))
            assert (scene.run(eyes, level, output=True)["primID"] >= 0).all()


def test_what_stands_beside_a_bin_is_not_inside():
    standing = 0
    for seed in range(300):
        surroundings = draw_bin(CONFIG, np.random.default_rng(seed))
        lower, upper = surroundings.bounds
        for each in surroundings.structures:
            if each.name in (BIN_WALL, FLOOR):
                continue
            if each.corners[:, 2].min() > TABLE_HEIGHT + 0.1:
                continue  # an arm that comes in from above
            standing += 1
            flat = each.corners[:, :2]
            beside = (flat.max(axis=0) < lower + 1e-4) | (flat.min(axis=0) > upper - 1e-4)
            assert beside.any(), (seed, each.name)
    assert standing > 50


def test_all_is_in_the_precision_of_recipes_and_the_same_for_the_same_seed(tables, bins):
    for draw, drawn in ((draw_table, tables), (draw_bin, bins)):
        for seed in SEEDS[:8]:
            again = draw(CONFIG, np.random.default_rng(seed))
            assert again.extent == drawn[seed].extent
            assert again.extent == tuple(np.array(again.extent, np.float32).tolist())
            for first, second in zip(again.structures, drawn[seed].structures, strict=True):
                assert first.name == second.name
                assert first.corners.dtype == np.float32
                np.testing.assert_array_equal(first.corners, second.corners)


def test_every_thing_occurs_and_many_scenes_have_none(tables, bins):
    names = [{each.name for each in table.structures} - {"table edge", FLOOR} for table in tables]
    assert set().union(*names) == {"wall", "post", "robot", "screen"}
    assert any(not each for each in names)
    of_bins = [{each.name for each in one.structures} - {BIN_WALL, FLOOR} for one in bins]
    assert set().union(*of_bins) == {"wall", "post", "robot"}

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import KDTree

from icgnet.errors import InputError
from icgnet.geometry.camera import DEFAULT_INTRINSICS, pixel_rays, sphere_pose
from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.geometry.tsdf import fuse

HALF = DEFAULT_INTRINSICS * [[0.5], [0.5], [1.0]]
SHAPE = (240, 320)
CENTRE, RADIUS = np.array([0.15, 0.15, 0.12]), 0.06
TABLE = 0.05


def camera(polar=0.7, azimuth=0.4, distance=0.5):
    return sphere_pose(np.array([0.15, 0.15, 0.1]), distance, polar, azimuth)


def sphere_depth(pose, table=True, intrinsics=HALF, shape=SHAPE):
    """Depth image of a sphere above a table, by its equation."""
    rays = pixel_rays(intrinsics, shape) @ pose[:3, :3].T
    offset = pose[:3, 3] - CENTRE
    a, b, c = (rays**2).sum(-1), rays @ offset, offset @ offset - RADIUS**2
    root = b * b - a * c
    depth = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
    if table:
        depth = np.minimum(depth, (TABLE - pose[2, 3]) / rays[..., 2])
    return np.where(np.isfinite(depth), depth, 0.0)


def dense_surface_points(depths, intrinsics, poses, resolution, size=0.3):
    """The definition, voxel by voxel: every voxel of the whole grid, then every pair of neighbours."""
    voxel = size / resolution
    truncation = 4 * voxel
    centres = (np.argwhere(np.ones((resolution,) * 3)) + 0.5) * voxel
    total, weight = np.zeros(len(centres)), np.zeros(len(centres))
    for depth, pose in zip(depths, poses, strict=True):
        x, y, z = transform_points(invert_transform(pose), centres).T
        u = np.floor(intrinsics[0, 0] * x / z + intrinsics[0, 2] + 0.5).astype(int)
        v = np.floor(intrinsics[1, 1] * y / z + intrinsics[1, 2] + 0.5).astype(int)
        inside = (z > 0) & (u >= 0) & (v >= 0) & (u < depth.shape[1]) & (v < depth.shape[0])
        u, v = np.where(inside, u, 0), np.where(inside, v, 0)
        distance = (depth[v, u] - z) * np.linalg.norm(pixel_rays(intrinsics, depth.shape), axis=-1)[v, u]
        seen = inside & (depth[v, u] > 0) & (distance > -truncation)
        total[seen] += np.minimum(1.0, distance[seen] / truncation)
        weight[seen] += 1
    with np.errstate(invalid="ignore"):
        values = (total / weight).reshape((resolution,) * 3)
    values[~(np.abs(values) < 0.98)] = np.nan
    points = []
    for axis in range(3):
        lower, upper = [slice(None)] * 3, [slice(None)] * 3
        lower[axis], upper[axis] = slice(None, -1), slice(1, None)
        before, after = values[tuple(lower)], values[tuple(upper)]
        index = np.argwhere(before * after < 0)
        here, there = np.abs(before[tuple(index.T)]), np.abs(after[tuple(index.T)])
        position = index + 0.5
        position[:, axis] += here / (here + there)
        points.append(position * voxel)
    return np.concatenate(points)


def assert_same_points(found, expected, share=1.0):
    assert abs(len(found) - len(expected)) <= (1 - share) * len(expected)
    distance, _ = KDTree(found).query(expected)
    assert (distance < 1e-5).mean() >= share


@pytest.mark.parametrize("resolution", [30, 41, 60])
def test_blocks_give_the_points_of_the_whole_grid(resolution):
    poses = [camera(), camera(0.9, 2.5)]
    depths = [sphere_depth(pose) for pose in poses]
    for count in (1, 2):
        found = fuse(depths[:count], [HALF] * count, poses[:count], resolution).surface_points()
        expected = dense_surface_points(depths[:count], HALF, poses[:count], resolution)
        # In 32 bits a few voxels on the border between two pixels ask the other one.
        assert_same_points(found, expected, share=0.995)


def test_points_lie_on_the_sphere_and_the_table_within_a_fraction_of_a_voxel():
    pose = camera()
    grid = fuse([sphere_depth(pose)], [HALF], [pose], 180)
    points = grid.surface_points()
    on_sphere = np.abs(np.linalg.norm(points - CENTRE, axis=1) - RADIUS)
    error = np.minimum(on_sphere, np.abs(points[:, 2] - TABLE))
    assert np.median(error) < 0.15 * grid.voxel
    # Where the sphere is seen from its side, distances along the ray are longer than those to the surface.
    assert np.percentile(error, 95) < 1.0 * grid.voxel


@pytest.mark.parametrize("resolution", [40, 120, 180])
def test_a_level_plane_has_one_point_for_each_column_of_voxels(resolution):
    pose = camera(polar=0.05)
    plane = (TABLE + 0.021 - pose[2, 3]) / (pixel_rays(HALF, SHAPE) @ pose[2, :3])
    points = fuse([plane], [HALF], [pose], resolution).surface_points()
    # These borders lie between voxels in all three grids.
    inner = points[np.all((points[:, :2] > 0.09) & (points[:, :2] < 0.21), axis=1)]
    assert len(inner) == round(0.12 * resolution / 0.3) ** 2
    np.testing.assert_allclose(inner[:, 2], TABLE + 0.021, atol=1e-4)


def test_nothing_is_found_where_nothing_was_seen():
    pose = camera()
    depth = sphere_depth(pose)
    points = fuse([depth], [HALF], [pose], 120).surface_points()
    away = (points - CENTRE) @ (pose[:3, 3] - CENTRE)
    on_sphere = np.linalg.norm(points - CENTRE, axis=1) < RADIUS + 0.004
    assert on_sphere.sum() > 500
    # The far side of the sphere is hidden, apart from a rim as wide as a voxel.
    assert (away[on_sphere] > -0.004 * np.linalg.norm(pose[:3, 3] - CENTRE)).all()
    half = depth.copy()
    half[:, :160] = 0.0
    pixels = transform_points(invert_transform(pose), fuse([half], [HALF], [pose], 120).surface_points()) @ HALF.T
    assert (pixels[:, 0] / pixels[:, 2] > 158.0).all()


@pytest.mark.parametrize("depth", [np.zeros(SHAPE), np.full(SHAPE, np.nan), np.full(SHAPE, 3.0)])
def test_an_image_without_anything_near_gives_an_empty_cloud(depth):
    points = fuse([depth], [HALF], [camera()], 60).surface_points()
    assert points.shape == (0, 3)


def test_more_views_average_the_noise():
    rng = np.random.default_rng(0)
    pose = camera()
    depth = sphere_depth(pose)
    noisy = [depth + 0.001 * rng.standard_normal(SHAPE) for _ in range(9)]
    errors = []
    for count in (1, 9):
        points = fuse(noisy[:count], [HALF] * count, [pose] * count, 120).surface_points()
        table = points[np.linalg.norm(points - CENTRE, axis=1) > RADIUS + 0.01]
        errors.append(np.std(table[:, 2]))
    assert errors[1] < 0.5 * errors[0]


def test_a_second_view_shows_the_other_side():
    poses = [camera(azimuth=0.0), camera(azimuth=np.pi)]
    depths = [sphere_depth(pose) for pose in poses]
    one = fuse(depths[:1], [HALF], poses[:1], 90).surface_points()
    both = fuse(depths, [HALF] * 2, poses, 90).surface_points()
    for points, seen in ((one, False), (both, True)):
        side = (points[:, 0] < CENTRE[0] - 0.03) & (np.abs(np.linalg.norm(points - CENTRE, axis=1) - RADIUS) < 0.002)
        assert (side.sum() > 200) == seen


@given(azimuth=st.floats(-3.0, 3.0), polar=st.floats(0.1, 1.1), height=st.floats(0.052, 0.09))
def test_leaving_out_the_table_leaves_everything_above_it(azimuth, polar, height):
    pose = camera(polar, azimuth)
    depth = sphere_depth(pose)
    whole = fuse([depth], [HALF], [pose], 90).surface_points()
    upper = fuse([depth], [HALF], [pose], 90, least_height=height).surface_points()
    wanted = whole[whole[:, 2] > height + 0.004]
    distance, _ = KDTree(upper).query(wanted)
    assert (distance == 0).all()


def test_the_cloud_moves_with_the_camera():
    first, second = camera(azimuth=0.0), camera(azimuth=np.pi / 2)
    points = [fuse([sphere_depth(pose)], [HALF], [pose], 60).surface_points() for pose in (first, second)]
    turned = np.column_stack([0.3 - points[0][:, 1], points[0][:, 0], points[0][:, 2]])
    assert_same_points(points[1], turned, share=0.97)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([], [], [], 40), "0 images"),
        (([np.ones(SHAPE)], [HALF], [], 40), "0 poses"),
        (([np.ones(SHAPE)], [HALF], [np.eye(4)], 0), "got 0"),
        (([np.ones(SHAPE)], [np.zeros((3, 3))], [np.eye(4)], 40), "intrinsics"),
    ],
)
def test_wrong_use_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        fuse(*arguments)

"""What a planner gets to see in the benchmark: one camera, a noisy depth image, and the fused cloud of the objects."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from icgnet.benchmark.config import NoiseName, ViewName
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.geometry.camera import DEFAULT_INTRINSICS, DEFAULT_SHAPE, sphere_pose, unproject
from icgnet.geometry.clouds import PointCloud, radius_outlier_mask, voxel_downsample
from icgnet.geometry.transforms import transform_points
from icgnet.geometry.tsdf import fuse
from icgnet.geometry.workspace import CENTRE, TABLE_HEIGHT
from icgnet.grasping.gripper import Gripper
from icgnet.objects.kinds import WIDE_KINDS, Kind
from icgnet.objects.object_set import ObjectSet
from icgnet.sensors.config import NOISES, SensorNoise, exactly
from icgnet.sensors.noise import corrupt_depth, corrupt_points
from icgnet.settings import check_choice
from icgnet.simulation.camera import SceneRenderer
from icgnet.simulation.scene import Scene, scene_triangles


@dataclass(frozen=True)
class CameraRange:
    """Where the camera may stand: on a part of a sphere around a point above the table's centre.

    Attributes:
        target: height that the camera looks at [m].
        radius: least and largest distance from there [m].
        polar_deg: least and largest angle from the vertical [degrees].
        azimuth_deg: least and largest angle about the vertical [degrees].
    """

    target: float
    radius: tuple[float, float]
    polar_deg: tuple[float, float]
    azimuth_deg: tuple[float, float]


VIEWS: dict[ViewName, CameraRange] = {
    "random": CameraRange(0.25, (0.60, 0.75), (45.0, 60.0), (0.0, 180.0)),
    "side": CameraRange(0.10, (0.60, 0.60), (60.0, 60.0), (-90.0, -90.0)),
    "top": CameraRange(0.25, (0.60, 0.75), (0.0, 2.0), (0.0, 180.0)),
}
"""The benchmark's random view; the fixed side view of the table with depth noise; "Challenging Viewpoints"."""

SENSORS: dict[NoiseName, SensorNoise] = {
    "none": NOISES["clean"],
    "gaussian": SensorNoise(gaussian=exactly(0.0008)),
    "dex": NOISES["dex"],
    "stereo": NOISES["stereo"],
}
"""No noise; 0.8 mm on the points of the cloud, as published; noise on the depth image; a RealSense D400."""

WIDE_POLAR_DEG: dict[Kind, tuple[float, float]] = {"table": (20.0, 55.0), "bin": (0.0, 35.0)}
"""Angle of cameras from the vertical before tables and bins [degrees]."""
WIDE_DISTANCE = (0.45, 0.7)
"""Their distance from the middle of the support [m], and how much farther for each metre of its longer side."""
CAMERAS_TRIED = 30
FEWEST_SEEN = 0.5
"""Cameras that see fewer of the objects stand behind something, and are drawn again."""
WIDE_SPACING, TABLE_NOISE = 0.003, 0.01
"""Distance of the points of wide clouds, and how far above the table they begin, for the sake of noise [m]."""

RESOLUTION = 180  # voxels along the workspace's edge of the published fusion
LOWER, UPPER = np.array([0.02, 0.02, 0.055]), np.array([0.28, 0.28, 0.30])
OUTLIER_RADIUS, OUTLIER_NEIGHBOURS = 0.02, 20
FEWEST_POINTS = 100


@dataclass(frozen=True, eq=False)
class Observation:
    """Everything that a planner may use.

    Attributes:
        cloud: points on the objects in the world, without the table, with the camera's position [m]; may be empty.
        depth: [h w] the noisy depth image [m], 0 where nothing was measured.
        intrinsics: camera matrix [pixels].
        T_world_camera: pose of the camera (x right, y down, z forward).
        table_height: of the table plane in the world [m].
        gripper: the hand.
        full_opening: whether the hand will approach fully opened, whatever opening the planner gives.
        rng: source of everything that the planner draws.
        wide: whether it is a whole table or bin, of which `cloud` holds all that stands out of the support.
        truth: what really stands there, only for planners that ask for it, as a ceiling for the others.
    """

    cloud: PointCloud
    depth: Float[np.ndarray, "h w"]
    intrinsics: Float[np.ndarray, "3 3"]
    T_world_camera: Float[np.ndarray, "4 4"]
    table_height: float
    gripper: Gripper
    full_opening: bool
    rng: np.random.Generator
    truth: TrueShapes | None = None
    wide: bool = False

    def openings(self, widths: Float[np.ndarray, "g"]) -> Float[np.ndarray, "g"]:
        """Openings [m] with which the hand would approach objects of these widths [m]."""
        return np.full(len(widths), self.gripper.max_opening) if self.full_opening else self.gripper.opening(widths)


def draw_camera(view: ViewName, rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    """T_world_camera of a camera drawn for a view; draws radius, polar angle and azimuth, in this order."""
    chosen = VIEWS[view]
    radius = rng.uniform(*chosen.radius)
    polar, azimuth = np.deg2rad(rng.uniform(*chosen.polar_deg)), np.deg2rad(rng.uniform(*chosen.azimuth_deg))
    return sphere_pose(np.array([CENTRE[0], CENTRE[1], chosen.target]), radius, polar, azimuth)


def observe(
    scene: Scene,
    object_set: ObjectSet,
    view: ViewName,
    noise: NoiseName,
    gripper: Gripper,
    full_opening: bool,
    rng: np.random.Generator,
) -> Observation:
    """A picture of a scene by a camera that is drawn, and the cloud that the published benchmark makes of it.

    The depth image is fused into a distance grid of 180^3 over the workspace, the points on its zero crossing are cut
    off 5 mm above the table and 2 cm inside the workspace, and lonely points are removed.

    Args:
        scene: what stands on the table.
        object_set: of the scene.
        view: where the camera may stand.
        noise: what the sensor does.
        gripper: the hand, for the planner.
        full_opening: see `Observation`.
        rng: source of every draw, handed on to the planner.

    Raises:
        InputError: unknown view or noise.
    """
    sensor = SENSORS[check_choice("noise", noise, tuple(SENSORS))]
    if scene.kind in WIDE_KINDS:
        return _observe_wide(scene, object_set, sensor, gripper, full_opening, rng)
    pose = draw_camera(check_choice("view", view, tuple(VIEWS)), rng)
    image = SceneRenderer(*scene_triangles(scene, object_set)).render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, pose)
    image = corrupt_depth(image, DEFAULT_INTRINSICS, sensor, rng)
    depth = np.asarray(image.depth, np.float64)
    points, _ = corrupt_points(points_above_table(depth, DEFAULT_INTRINSICS, pose), sensor, rng)
    cloud = PointCloud(without_lonely_points(points), pose[:3, 3], "world")
    return Observation(cloud, depth, DEFAULT_INTRINSICS, pose, TABLE_HEIGHT, gripper, full_opening, rng)


def _observe_wide(
    scene: Scene,
    object_set: ObjectSet,
    sensor: SensorNoise,
    gripper: Gripper,
    full_opening: bool,
    rng: np.random.Generator,
) -> Observation:
    """A picture of a whole table or bin; its cloud holds what is seen above the support, structures as well."""
    renderer = SceneRenderer(*scene_triangles(scene, object_set), extent=scene.surroundings.extent)
    for _ in range(CAMERAS_TRIED):
        pose = _wide_camera(scene, rng)
        image = renderer.render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, pose)
        if len(np.unique(image.ids[image.ids >= 0])) >= FEWEST_SEEN * len(scene.objects):
            break
    depth = np.asarray(corrupt_depth(image, DEFAULT_INTRINSICS, sensor, rng).depth, np.float64)
    points = transform_points(pose, unproject(depth, DEFAULT_INTRINSICS)[depth > 0])
    lower, upper = scene.surroundings.bounds
    over = ((points[:, :2] > lower) & (points[:, :2] < upper)).all(axis=1)
    points, _ = corrupt_points(points[over & (points[:, 2] > TABLE_HEIGHT + TABLE_NOISE)], sensor, rng)
    points = without_lonely_points(voxel_downsample(points, WIDE_SPACING)[0]) if len(points) else points
    cloud = PointCloud(points, pose[:3, 3], "world")
    return Observation(cloud, depth, DEFAULT_INTRINSICS, pose, TABLE_HEIGHT, gripper, full_opening, rng, wide=True)


def _wide_camera(scene: Scene, rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    """T_world_camera of a camera that looks at the middle of the support."""
    lower, upper = scene.surroundings.bounds
    nearest, more = WIDE_DISTANCE
    distance = nearest + more * float((upper - lower).max()) + rng.uniform(0.0, 0.1)
    polar, azimuth = np.deg2rad(rng.uniform(*WIDE_POLAR_DEG[scene.kind])), rng.uniform(0.0, 2.0 * np.pi)
    return sphere_pose(np.array([*((lower + upper) / 2), TABLE_HEIGHT]), distance, polar, azimuth)


def points_above_table(
    depth: Float[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"], T_world_camera: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "n 3"]:
    """Surface points [m] of a depth image that is fused as published, above the table and inside the workspace."""
    grid = fuse([depth], [intrinsics], [T_world_camera], RESOLUTION, least_height=LOWER[2] - 0.01)
    points = grid.surface_points()
    return points[((points >= LOWER) & (points <= UPPER)).all(axis=1)]


def without_lonely_points(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    """Those with neighbours; none where fewer than a hundred remain."""
    if len(points):
        points = points[radius_outlier_mask(points, OUTLIER_RADIUS, OUTLIER_NEIGHBOURS)]
    return points if len(points) >= FEWEST_POINTS else np.zeros((0, 3))

"""What a planner gets to see in the benchmark: one camera, a noisy depth image, and the fused cloud of the objects."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from icgnet.benchmark.config import NoiseName, ViewName
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.geometry.camera import DEFAULT_INTRINSICS, DEFAULT_SHAPE, pixel_rays, sphere_pose
from icgnet.geometry.clouds import PointCloud, radius_outlier_mask, voxel_downsample
from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.geometry.tsdf import fuse
from icgnet.geometry.workspace import CENTRE, TABLE_HEIGHT
from icgnet.grasping.gripper import Gripper
from icgnet.objects.kinds import WIDE_KINDS
from icgnet.objects.object_set import ObjectSet
from icgnet.sensors.config import NOISES, SensorNoise, exactly
from icgnet.sensors.noise import corrupt_depth, corrupt_points
from icgnet.sensors.wide import Picture, take_wide_picture
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
"""No noise; 0.8 mm on the points of the cloud, as published; noise on the depth image; that of a RealSense D435."""

WIDE_SPACING = 0.003
"""The cloud of a wide scene has one point in a cube of this edge [m]."""

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
        truth: what really stands there, only for planners that ask for it, as a ceiling for the others.
        is_wide: whether this is a whole table or bin, with things around that are no objects, also in the cloud.
        target: [h w] visible pixels of the one object that is to be grasped; None if any will do.
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
    is_wide: bool = False
    target: Bool[np.ndarray, "h w"] | None = None

    def wanted(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
        """Which points [m, world] that the camera saw lie in a pixel of the target; all of them if there is none."""
        if self.target is None:
            return np.ones(len(points), bool)
        seen = transform_points(invert_transform(self.T_world_camera), points) @ self.intrinsics.T
        columns, rows = np.round(seen[:, :2] / np.maximum(seen[:, 2:], 1e-6)).astype(int).T
        height, width = self.target.shape
        inside = (seen[:, 2] > 0) & (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        inside[inside] = self.target[rows[inside], columns[inside]]
        return inside

    def openings(self, widths: Float[np.ndarray, "g"]) -> Float[np.ndarray, "g"]:
        """Openings [m] with which the hand would approach objects of these widths [m]."""
        return np.full(len(widths), self.gripper.max_opening) if self.full_opening else self.gripper.opening(widths)


def draw_camera(view: ViewName, rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    """T_world_camera of a camera drawn for a view; draws radius, polar angle and azimuth, in this order."""
    chosen = VIEWS[view]
    radius = rng.uniform(*chosen.radius)
    polar, azimuth = np.deg2rad(rng.uniform(*chosen.polar_deg)), np.deg2rad(rng.uniform(*chosen.azimuth_deg))
    return sphere_pose(np.array([CENTRE[0], CENTRE[1], chosen.target]), radius, polar, azimuth)


def take_picture(scene: Scene, object_set: ObjectSet, view: ViewName, rng: np.random.Generator) -> Picture:
    """A picture by a camera that is drawn; a wide scene has a view of its own, see `take_wide_picture`.

    Args:
        scene: what stands there.
        object_set: of the scene.
        view: where the camera may stand around scenes in the cube.
        rng: source of the draws.

    Raises:
        InputError: unknown view.
    """
    check_choice("view", view, tuple(VIEWS))
    if scene.kind in WIDE_KINDS:
        return take_wide_picture(scene, object_set, rng)
    renderer = SceneRenderer(*scene_triangles(scene, object_set), extent=scene.surroundings.extent)
    pose = draw_camera(view, rng)
    return Picture(renderer.render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, pose), DEFAULT_INTRINSICS, pose)


def observe(
    scene: Scene,
    object_set: ObjectSet,
    view: ViewName,
    noise: NoiseName,
    gripper: Gripper,
    full_opening: bool,
    rng: np.random.Generator,
) -> Observation:
    """A picture of a scene by a camera that is drawn, and the cloud that is made of it; see `sense`.

    Args:
        scene: what stands on the table.
        object_set: of the scene.
        view: where the camera may stand around scenes in the cube; see `take_picture`.
        noise: what the sensor does.
        gripper: the hand, for the planner.
        full_opening: see `Observation`.
        rng: source of every draw, handed on to the planner.

    Raises:
        InputError: unknown view or noise.
    """
    picture = take_picture(scene, object_set, view, rng)
    return sense(picture, scene.kind in WIDE_KINDS, noise, gripper, full_opening, rng)


def sense(
    picture: Picture, is_wide: bool, noise: NoiseName, gripper: Gripper, full_opening: bool, rng: np.random.Generator
) -> Observation:
    """What a sensor makes of a picture, and the cloud of it.

    In the cube as in the published benchmark: the depth image is fused into a distance grid of 180^3 over the
    workspace, the points on its zero crossing are cut off 5 mm above the table and 2 cm inside the workspace, and
    lonely points are removed. Of wide scenes: the measured points 5 mm above the table, thinned to one in 3 mm, without
    lonely ones.

    Raises:
        InputError: unknown noise.
    """
    sensor = SENSORS[check_choice("noise", noise, tuple(SENSORS))]
    view = (picture.intrinsics, picture.T_world_camera)
    depth = np.asarray(corrupt_depth(picture.image, picture.intrinsics, sensor, rng).depth, np.float64)
    above = measured_above_table(depth, *view) if is_wide else points_above_table(depth, *view)
    points, _ = corrupt_points(above, sensor, rng)
    cloud = PointCloud(without_lonely_points(points), picture.T_world_camera[:3, 3], "world")
    return Observation(cloud, depth, *view, TABLE_HEIGHT, gripper, full_opening, rng, is_wide=is_wide)


def measured_above_table(
    depth: Float[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"], T_world_camera: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "n 3"]:
    """Points [m] of the pixels of a depth image that lie above the table, thinned."""
    # Not `unproject`, which refuses a picture in which nothing was measured: that is an empty cloud.
    points = (pixel_rays(intrinsics, depth.shape) * depth[..., None])[depth > 0]
    points = transform_points(T_world_camera, points)
    thinned, _ = voxel_downsample(points[points[:, 2] >= LOWER[2]], WIDE_SPACING)
    return thinned


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

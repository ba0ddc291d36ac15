"""The best pair of seen points that face each other: a grasp from geometry alone, without learning."""

import numpy as np
from jaxtyping import Float, Int

from icgnet.benchmark.observation import Observation
from icgnet.benchmark.planner import Plan
from icgnet.geometry.clouds import estimate_normals, voxel_downsample
from icgnet.grasping.collision import POINT_SPACING, check_collisions, draw_back, hits_points
from icgnet.grasping.frame import APPROACH_ANGLES, grasp_poses
from icgnet.grasping.gripper import Gripper

SPACING = 0.005  # of the points that are paired [m]
MOST_POINTS = 1000  # larger clouds are thinned by chance
THINNEST = 0.008  # nearer points are noise on one surface [m]
PAIRS = 64  # that are checked for collisions
CLEAR = 0.006  # a hand that keeps this distance from everything seen is preferred [m]
GRASPS = 64  # that are returned at most


class AntipodalPlanner:
    """Pairs of points whose normals lie in each other's friction cone, with a free hand at some approach angle."""

    needs_truth = False

    def plan(self, observation: Observation) -> Plan:
        """Grasps without collisions with what was seen, those of the most opposed points first."""
        cloud, gripper = observation.cloud, observation.gripper
        wanted = cloud.points[observation.wanted(cloud.points)]
        if len(wanted) == 0:
            return Plan.nothing()
        points, _ = voxel_downsample(wanted, SPACING)
        points = observation.rng.permutation(points)[:MOST_POINTS]
        normals = estimate_normals(cloud.points, cloud.viewpoint, queries=points)
        first, second, quality = _opposed_pairs(points, normals, gripper)
        if len(first) == 0:
            return Plan.nothing()
        offsets = points[first] - points[second]
        widths = np.linalg.norm(offsets, axis=1)
        angles = len(APPROACH_ANGLES)
        poses = grasp_poses(points[first], offsets / widths[:, None], widths, gripper.finger_reach).reshape(-1, 4, 4)
        openings = observation.openings(np.repeat(widths, angles))
        poses = draw_back(poses, openings, gripper, observation.table_height)
        seen, _ = voxel_downsample(cloud.points, POINT_SPACING)
        free = check_collisions(poses, openings, gripper, _nothing_known, observation.table_height, points=seen).free
        poses, openings, quality = poses[free], openings[free], np.repeat(quality, angles)[free]
        clear = ~hits_points(poses, openings, gripper, seen, margin=CLEAR)
        # In [0, 1]: mostly the pair, then a free space around the hand and an approach from above.
        scores = quality * (0.5 + 0.25 * clear + 0.25 * np.maximum(-poses[:, 2, 2], 0.0))
        best = np.argsort(-scores, kind="stable")[:GRASPS]
        return Plan(poses[best], openings[best], scores[best])


def _opposed_pairs(
    points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], gripper: Gripper
) -> tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"], Float[np.ndarray, "k"]]:
    """Indices of the best pairs, and the smaller cosine between a normal and the line through both points."""
    offsets = points[:, None] - points[None]
    distances = np.linalg.norm(offsets, axis=2)
    fits = (distances > THINNEST) & (distances < gripper.max_opening - gripper.clearance)
    along = np.einsum("nmk,nk->nm", offsets, normals) / np.maximum(distances, THINNEST)
    # Seen from the other end, the line points the other way.
    quality = np.minimum(along, along.T)
    in_cone = fits & (quality >= np.cos(np.arctan(gripper.friction)))
    first, second = np.nonzero(np.triu(in_cone))
    best = np.argsort(-quality[first, second], kind="stable")[:PAIRS]
    first, second = first[best], second[best]
    return first, second, quality[first, second]


def _nothing_known(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Without learning, nothing is known of the space that was not seen."""
    return np.zeros(len(points))

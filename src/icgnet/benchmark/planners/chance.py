"""Grasps drawn at random on what the camera saw: the floor of the benchmark."""

import numpy as np

from icgnet.benchmark.observation import Observation
from icgnet.benchmark.planner import Plan
from icgnet.geometry.clouds import estimate_normals
from icgnet.grasping.frame import APPROACH_ANGLES, grasp_poses

GRASPS = 16
THINNEST = 0.008  # of what is drawn [m]


class RandomPlanner:
    """Seen points, their normals, and any approach angle and width; nothing is checked."""

    needs_truth = False

    def plan(self, observation: Observation) -> Plan:
        """Random grasps in random order."""
        cloud, gripper, rng = observation.cloud, observation.gripper, observation.rng
        points = cloud.points[observation.wanted(cloud.points)]
        if len(points) == 0:
            return Plan.nothing()
        contacts = points[rng.integers(len(points), size=GRASPS)]
        normals = estimate_normals(cloud.points, cloud.viewpoint, queries=contacts)
        widths = rng.uniform(THINNEST, gripper.max_opening, GRASPS)
        angles = rng.integers(len(APPROACH_ANGLES), size=GRASPS)
        poses = grasp_poses(contacts, normals, widths, gripper.finger_reach)[np.arange(GRASPS), angles]
        return Plan(poses, observation.openings(widths), np.zeros(GRASPS))

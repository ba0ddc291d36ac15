"""A planner of your own, tried on one simulated scene.

python examples/04_own_planner.py
cd examples; icgnet benchmark clutter --planner 04_own_planner:FromAbove   # ... and measured
"""

import numpy as np

from icgnet.benchmark.observation import Observation, observe
from icgnet.benchmark.planner import Plan
from icgnet.geometry.transforms import make_transform
from icgnet.grasping.gripper import load_gripper
from icgnet.objects.object_set import load_object_set
from icgnet.simulation.scenes import spawn_scene
from icgnet.simulation.workcell import PROTOCOLS, Workcell


class FromAbove:
    """Grasps the highest thing from straight above, across its narrower side."""

    needs_truth = False

    def plan(self, observation: Observation) -> Plan:
        points = observation.cloud.points
        if len(points) == 0:
            return Plan.nothing()
        top = points[points[:, 2].argmax()]
        near = points[np.linalg.norm(points[:, :2] - top[:2], axis=1) < 0.04]
        high = near[near[:, 2] > top[2] - 0.02]
        # The direction in which the points near the top are spread least.
        x, y = np.linalg.eigh(np.cov(high[:, :2].T))[1][:, 0]
        closing, approach = np.array([x, y, 0.0]), np.array([0.0, 0.0, -1.0])
        extent = high @ closing
        middle = high.mean(axis=0) + ((extent.max() + extent.min()) / 2 - extent.mean()) * closing
        middle[2] = max(top[2] - 0.02, observation.table_height + 0.002)
        pose = make_transform(np.stack([np.cross(closing, approach), closing, approach], axis=1), middle)
        return Plan(pose[None], observation.openings(np.array([np.ptp(extent)])), np.ones(1))


def main() -> None:
    objects, gripper, rng = load_object_set("procedural"), load_gripper(), np.random.default_rng(2)
    scene = spawn_scene("packed", objects, "val", rng, count=5)
    observation = observe(scene, objects, "random", "gaussian", gripper, full_opening=True, rng=rng)
    plan = FromAbove().plan(observation)
    print(f"{len(scene.objects)} objects, {len(observation.cloud)} points, {len(plan)} grasp")
    outcome = Workcell(scene, objects, gripper).execute(plan.poses[0], plan.openings[0], PROTOCOLS["strict"])
    print(f"{scene.objects[outcome.target].name}: {outcome.cause.value}")


if __name__ == "__main__":
    main()

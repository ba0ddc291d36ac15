"""How long it takes to plan a pick: scenes of the simulator, true shapes in place of predicted ones, no network.

python scripts/pick_times.py --scenes 40 --kind packed
"""

import argparse
import time

import numpy as np

from icgnet.arm.arm import Arm
from icgnet.arm.pick import PickSettings, plan_pick
from icgnet.arm.replay import replay
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.transforms import make_transform
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.collision import check_collisions, draw_back
from icgnet.grasping.frame import APPROACH_ANGLES, grasp_poses
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.inference.prediction import DetectedObject, Prediction
from icgnet.objects.classes import CLASSES
from icgnet.objects.object_set import load_object_set
from icgnet.simulation.contacts import sample_contacts
from icgnet.simulation.scenes import spawn_scene

CONTACTS = 400
ANGLES = len(APPROACH_ANGLES)
T_BASE_WORLD = make_transform(np.eye(3), np.array([0.35, -0.15, -TABLE_HEIGHT]))
"""The arm stands on the table, the middle of the workspace half a metre in front of it."""
DROP = np.array([0.3, 0.45, 0.15])


def true_prediction(shapes: TrueShapes, gripper: Gripper, rng: np.random.Generator) -> Prediction:
    """The true shapes of a scene as a prediction, with free grasps on them, those from above first."""
    contacts = sample_contacts(list(shapes.meshes), CONTACTS, rng)
    widths = contacts.widths.min(axis=1)
    fits = (widths > 0.008) & (widths + 2 * gripper.clearance < gripper.max_opening)
    lines = np.flatnonzero(fits)
    poses = grasp_poses(contacts.positions[lines], contacts.normals[lines], widths[lines], gripper.finger_reach)
    of_line, poses = np.repeat(lines, ANGLES), poses.reshape(-1, 4, 4)
    openings = gripper.opening(widths[of_line])
    poses = draw_back(poses, openings, gripper, TABLE_HEIGHT)

    def occupancy(points: np.ndarray) -> np.ndarray:
        return (shapes.distances(points).min(axis=0, initial=1.0) < 0.0).astype(float)

    free = check_collisions(poses, openings, gripper, occupancy, TABLE_HEIGHT).free
    rows = of_line[free]
    scores = np.clip(0.5 - 0.4 * poses[free][:, 2, 2] + 0.1 * rng.uniform(size=len(rows)), 0.0, 1.0)
    angles = np.tile(np.arange(ANGLES), len(lines))[free]
    grasps = Grasps(
        poses[free], widths[rows], openings[free], scores, contacts.objects[rows], contacts.positions[rows], angles
    )
    clouds = [np.asarray(mesh.sample(400, seed=0)) for mesh in shapes.meshes]
    labels = np.repeat(np.arange(len(clouds)), [len(cloud) for cloud in clouds])
    points = np.concatenate([np.zeros((0, 3)), *clouds])
    objects = tuple(
        DetectedObject(number, 1.0, "other", 1.0, clouds[number], lambda mesh=mesh: mesh)
        for number, mesh in enumerate(shapes.meshes)
    )
    return Prediction(
        objects=objects,
        grasps=grasps.sorted(),
        frame_id="world",
        rejected={},
        timings_ms={},
        cloud=PointCloud(points, None, "world"),
        cloud_instances=labels,
        T_frame_table=np.eye(4),
        gripper=gripper,
        classes=CLASSES,
        input_rows=np.arange(len(points)),
        input_shape=(len(points),),
    )


def main() -> None:
    """Plans one pick in each of several scenes and prints the times."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", type=int, default=40)
    parser.add_argument("--kind", default="packed")
    parser.add_argument("--objects", default="procedural")
    parser.add_argument("--obstacles", default="shapes")
    parser.add_argument("--release", default="drop")
    parser.add_argument("--count", type=int, default=6)
    parser.add_argument("--arm", default="fr3")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--replay", action=argparse.BooleanOptionalAction, default=True, help="play plans back at 1 ms")
    arguments = parser.parse_args()

    arm, gripper, object_set = Arm.load(arguments.arm), load_gripper(), load_object_set(arguments.objects)
    settings = PickSettings(obstacles=arguments.obstacles, release=arguments.release)
    times, busy, stages, refused, found = [], [], [], {}, 0
    for number in range(arguments.scenes):
        rng = np.random.default_rng([arguments.seed, number])
        scene = spawn_scene(arguments.kind, object_set, "train", rng, arguments.count)
        if not scene.objects:
            continue
        prediction = true_prediction(TrueShapes(scene, object_set), gripper, rng)
        if not len(prediction.grasps):
            continue
        drop = DROP if arguments.release == "drop" else np.array([0.3, 0.45, 0.0])
        start, start_busy = time.perf_counter(), time.process_time()
        plan = plan_pick(prediction, arm, T_BASE_WORLD, drop, settings)
        times.append(time.perf_counter() - start)
        busy.append(time.process_time() - start_busy)
        stages.append(plan.timings_ms)
        for reason, count in plan.refused.items():
            refused[reason] = refused.get(reason, 0) + count
        found += plan.is_found
        replayed = f", replay {replay(plan, arm)}" if plan.is_found and arguments.replay else ""
        faces = sum(len(body.mesh.faces) for body in plan.bodies)
        print(
            f"{number}: {len(scene.objects)} objects, {faces} faces, {len(prediction.grasps)} grasps, "
            f"{len(plan.refusals)} refused, {'found' if plan.is_found else 'none'}, {1e3 * times[-1]:.0f} ms "
            f"({1e3 * busy[-1]:.0f} ms of the processor), {plan.duration:.1f} s{replayed}",
            flush=True,
        )
    for name, values in (("by the clock", times), ("of the processor", busy)):
        median, late = np.percentile(1e3 * np.array(values), [50, 95])
        print(f"{found} of {len(times)} found; {name}: median {median:.0f} ms, p95 {late:.0f} ms")
    for stage in sorted({name for each in stages for name in each}):
        values = [each.get(stage, 0.0) for each in stages]
        print(f"  {stage}: median {np.median(values):.0f} ms, p95 {np.percentile(values, 95):.0f} ms")
    for reason, count in sorted(refused.items(), key=lambda item: -item[1]):
        print(f"  refused {count}: {reason}")


if __name__ == "__main__":
    main()

"""Where the published pile scenes lose their objects: the spawning rules in PyBullet, with the published settings.

Evidence for docs/decisions/0007-solid-table.md, not a part of the package; needs `pip install pybullet` (Python 3.11 or
older) and the VGN object set:

    python scripts/published_pile.py $ICGNET_OBJECTS --rate 80 --scenes 150
"""

import argparse
from pathlib import Path

import numpy as np
import pybullet
from scipy.spatial.transform import Rotation

SOLVER_ITERATIONS = {80: 100, 240: 150}  # of the two published variants
TABLE_TOP, TABLE_THICKNESS = 0.05, 0.012
WALL, BOX_LOWER, BOX_UPPER, BOX_HEIGHT = 0.0039, 0.02, 0.28, 0.13
WORKSPACE = 0.3


class Pile:
    """One scene: five objects dropped into the box, the box taken away, everything outside removed."""

    def __init__(self, urdfs: list[Path], rate: int, rng: np.random.Generator) -> None:
        self.urdfs, self.step_time, self.rng = urdfs, 1 / rate, rng
        self.time, self.objects = 0.0, []
        self.rolled_out = self.fell_through = 0
        pybullet.resetSimulation()
        pybullet.setPhysicsEngineParameter(fixedTimeStep=1 / rate, numSolverIterations=SOLVER_ITERATIONS[rate])
        pybullet.setGravity(0, 0, -9.81)
        fixed_box((0.6, 0.6, TABLE_THICKNESS / 2), (0.15, 0.15, TABLE_TOP - TABLE_THICKNESS / 2))

    def run(self, count: int) -> None:
        walls = drop_box()
        for _ in range(count):
            urdf = self.urdfs[self.rng.integers(len(self.urdfs))]
            turn = Rotation.random(random_state=self.rng).as_quat()
            x, y = self.rng.uniform(0.1, 0.2, 2)
            body = pybullet.loadURDF(str(urdf), (x, y, TABLE_TOP + 0.2), turn, globalScaling=self.rng.uniform(0.8, 1.0))
            pybullet.changeDynamics(body, -1, mass=0.5)
            self.objects.append(body)
            self.wait_for_rest(1.0)
        for wall in walls:
            pybullet.removeBody(wall)
        while self.remove_outside():
            pass

    def wait_for_rest(self, timeout: float) -> None:
        end = self.time + timeout
        while True:
            for _ in range(60):
                pybullet.stepSimulation()
            self.time += 60 * self.step_time
            speeds = [np.linalg.norm(np.concatenate(pybullet.getBaseVelocity(body))) for body in self.objects]
            if max(speeds, default=0.0) <= 0.01 or self.time >= end:
                return

    def remove_outside(self) -> bool:
        self.wait_for_rest(2.0)
        outside = False
        for body in list(self.objects):
            x, y, z = pybullet.getBasePositionAndOrientation(body)[0]
            if min(x, y, z) < 0 or max(x, y) > WORKSPACE:
                outside = True
                self.fell_through += z < 0
                self.rolled_out += z >= 0
                pybullet.removeBody(body)
                self.objects.remove(body)
        return outside


def fixed_box(half: tuple[float, float, float], centre: tuple[float, float, float]) -> int:
    shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half)
    body = pybullet.createMultiBody(0, shape, basePosition=centre)
    pybullet.changeDynamics(body, -1, lateralFriction=0.5)
    return body


def drop_box() -> list[int]:
    middle, half, height = (BOX_LOWER + BOX_UPPER) / 2, (BOX_UPPER - BOX_LOWER) / 2, TABLE_TOP + BOX_HEIGHT / 2
    edges = (BOX_LOWER + WALL / 2, BOX_UPPER - WALL / 2)
    along_y = [fixed_box((WALL / 2, half, BOX_HEIGHT / 2), (edge, middle, height)) for edge in edges]
    along_x = [fixed_box((half, WALL / 2, BOX_HEIGHT / 2), (middle, edge, height)) for edge in edges]
    return along_y + along_x


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("objects", type=Path, help="folder of the VGN object set")
    parser.add_argument(
        "--rate", type=int, choices=sorted(SOLVER_ITERATIONS), default=80, help="physics steps a second"
    )
    parser.add_argument("--scenes", type=int, default=150)
    arguments = parser.parse_args()
    urdfs = sorted((arguments.objects / "pile" / "test").glob("*.urdf"))
    pybullet.connect(pybullet.DIRECT)
    scenes = []
    for seed in range(arguments.scenes):
        scenes.append(Pile(urdfs, arguments.rate, np.random.default_rng(seed)))
        scenes[-1].run(5)
    kept = np.array([len(scene.objects) for scene in scenes])
    print(f"{arguments.scenes} scenes at {arguments.rate} Hz: {kept.mean():.2f} of 5 objects kept; lost a scene:")
    print(f"  {np.mean([scene.rolled_out for scene in scenes]):.2f} left the workspace on the table")
    print(f"  {np.mean([scene.fell_through for scene in scenes]):.2f} fell through the table")


if __name__ == "__main__":
    main()

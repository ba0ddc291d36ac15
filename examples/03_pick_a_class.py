"""Grasps of one class of objects only, with the complete shape of what is to be picked.

python examples/03_pick_a_class.py bottle
"""

import sys
from pathlib import Path

import numpy as np

import icgnet
from icgnet import Predictor

DEMO = Path(icgnet.__file__).parent / "captures" / "demo.npz"


def main(class_name: str = "box") -> None:
    capture = np.load(DEMO)
    result = Predictor.load().predict_depth(capture["depth"], capture["K"], capture["camera_pose"])

    wanted = result.of_class(class_name)
    print(f"{len(wanted.grasps)} of {len(result.grasps)} grasps are for objects of the class {class_name!r}")
    # The rule of the paper's robot: the highest grasp that is scored above 0.9, else 0.8, else 0.7.
    chosen = wanted.highest()
    if len(chosen) == 0:
        print("none is scored above 0.7: look from another side")
        return
    target = result.objects[chosen.instances[0]]
    size = target.mesh().extents if not target.mesh().is_empty else np.zeros(3)
    print(f"pick object {target.instance_id}, about {(100 * size).round(1)} cm, at {chosen.poses[0, :3, 3].round(3)} m")


if __name__ == "__main__":
    main(*sys.argv[1:])

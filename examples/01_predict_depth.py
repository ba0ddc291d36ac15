"""From a depth image to the best grasp.

python examples/01_predict_depth.py            # the capture that ships with the package
python examples/01_predict_depth.py view.npz   # your own: depth [m], K and, if known, camera_pose
"""

import sys
from pathlib import Path

import numpy as np

import icgnet
from icgnet import Predictor

DEMO = Path(icgnet.__file__).parent / "captures" / "demo.npz"


def main(path: Path = DEMO) -> None:
    capture = np.load(path)
    result = Predictor.load().predict_depth(capture["depth"], capture["K"], capture.get("camera_pose"))

    for item in result.objects:
        print(f"object {item.instance_id}: {item.class_name}, {len(item.points)} points")
    best = result.best()
    if len(best) == 0:
        print("no grasp is free of collisions:", result.rejected)
        return
    print(f"best grasp, score {best.scores[0]:.2f}, of object {best.instances[0]}, in the frame {result.frame_id!r}:")
    print(best.poses[0].round(3))


if __name__ == "__main__":
    main(*(Path(argument) for argument in sys.argv[1:]))

"""From a point cloud in the robot's frame to grasps for the robot's hand link.

python examples/02_predict_cloud.py
"""

from pathlib import Path

import numpy as np

import icgnet
from icgnet import Predictor
from icgnet.geometry.camera import unproject
from icgnet.geometry.transforms import transform_points

DEMO = Path(icgnet.__file__).parent / "captures" / "demo.npz"


def main() -> None:
    # Any cloud in metres with z up will do; here it comes from the depth image of the demo.
    capture = np.load(DEMO)
    points = transform_points(capture["camera_pose"], unproject(capture["depth"], capture["K"]).reshape(-1, 3))
    eye = capture["camera_pose"][:3, 3]

    predictor = Predictor.load()
    result = predictor.predict_cloud(points, viewpoint=eye, table_height=0.05)

    # The grasp frame lies between the finger tips; the robot moves its hand link.
    grasps = result.grasps
    hand_poses = grasps.poses @ predictor.gripper.T_grasp_base
    for pose, opening, score in list(zip(hand_poses, grasps.openings, grasps.scores, strict=True))[:5]:
        print(f"score {score:.2f}: open to {1e3 * opening:.0f} mm, hand link at {pose[:3, 3].round(3)} m")
    print("took", {stage: f"{duration:.0f} ms" for stage, duration in result.timings_ms.items()})


if __name__ == "__main__":
    main()

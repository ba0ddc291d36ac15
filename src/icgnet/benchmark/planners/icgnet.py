"""The network of this package, from the cloud to grasps that are checked against the predicted shapes."""

from dataclasses import replace
from pathlib import Path

from icgnet.benchmark.observation import Observation, points_above_table, without_lonely_points
from icgnet.benchmark.planner import Plan
from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.depth_scale import levelled_depth
from icgnet.inference.grasp_search import BEST_FEW, GraspSearch
from icgnet.predictor import Predictor


def cloud_on_table(observation: Observation) -> PointCloud:
    """The observation's cloud; or that of the picture set right, if it shows the table at a wrong height."""
    view = (observation.intrinsics, observation.T_world_camera)
    depth = levelled_depth(observation.depth, *view, observation.table_height)
    if depth is None or depth is observation.depth:
        return observation.cloud
    points = without_lonely_points(points_above_table(depth, *view))
    return PointCloud(points, observation.T_world_camera[:3, 3], "world")


class IcgNetPlanner:
    """Grasps of the predictor, the highest score first."""

    needs_truth = False

    def __init__(
        self,
        weights: Path | None = None,
        threads: int = 1,
        search: GraspSearch = BEST_FEW,
        level_table: bool = True,
        gripper: str | Path = "franka",
    ) -> None:
        """Loads the network.

        Args:
            weights: a file of weights; the shipped ones if None.
            threads: CPU threads of the network, for the whole process.
            search: how grasps are looked for; the opening is the observation's.
            level_table: whether a wrong depth scale, which the table's height tells, is taken out.
            gripper: the hand; see `Predictor.load`.

        Raises:
            DataError: the weights cannot be used.
            InputError: a number of threads below 1, or a hand that the weights do not know.
        """
        self._predictor = Predictor.load(weights, threads, gripper, search=search)
        self._level_table = level_table

    def plan(self, observation: Observation) -> Plan:
        """Grasps that touch nothing that was seen or is predicted; the prediction is in `details`."""
        cloud = cloud_on_table(observation) if self._level_table else observation.cloud
        gripper = observation.gripper
        if len(cloud) == 0:
            return Plan.nothing()
        search = replace(self._predictor.search, opening="full" if observation.full_opening else "predicted")
        predictor = Predictor(self._predictor.network, gripper, search, seed=int(observation.rng.integers(2**31)))
        prediction = predictor.predict_cloud(cloud.points, cloud.viewpoint, observation.table_height)
        grasps = prediction.grasps
        return Plan(grasps.poses, grasps.openings, grasps.scores, prediction)

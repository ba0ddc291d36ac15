"""The network of this package, from the cloud to grasps that are checked against the predicted shapes."""

from dataclasses import replace

from icgnet.benchmark.config import ClutterConfig
from icgnet.benchmark.observation import Observation, points_above_table, without_lonely_points
from icgnet.benchmark.planner import Plan
from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.depth_scale import levelled_depth
from icgnet.inference.prediction import Prediction
from icgnet.inference.tabletop import TableNotFoundError
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

    def __init__(self, config: ClutterConfig) -> None:
        """Loads the network of a benchmark.

        Raises:
            DataError: the weights cannot be used.
            InputError: a hand that the weights do not know.
        """
        self._predictor = Predictor.load(config.weights, config.threads, config.gripper, search=config.search)
        self._level_table = config.level_table

    def plan(self, observation: Observation) -> Plan:
        """Grasps that touch nothing that was seen or is predicted; the prediction is in `details`."""
        gripper = observation.gripper
        search = replace(self._predictor.search, opening="full" if observation.full_opening else "predicted")
        predictor = Predictor(self._predictor.network, gripper, search, seed=int(observation.rng.integers(2**31)))
        prediction = self._wide(predictor, observation) if observation.wide else self._cube(predictor, observation)
        if prediction is None:
            return Plan.nothing()
        grasps = prediction.grasps
        return Plan(grasps.poses, grasps.openings, grasps.scores, prediction)

    def _cube(self, predictor: Predictor, observation: Observation) -> Prediction | None:
        """What is found in the cloud of a packed or pile scene; None where that is empty."""
        cloud = cloud_on_table(observation) if self._level_table else observation.cloud
        if len(cloud) == 0:
            return None
        return predictor.predict_cloud(cloud.points, cloud.viewpoint, observation.table_height)

    def _wide(self, predictor: Predictor, observation: Observation) -> Prediction | None:
        """What is found in the picture of a whole table or bin; None where no table is."""
        view = (observation.intrinsics, observation.T_world_camera, observation.table_height)
        try:
            return predictor.predict_depth(observation.depth, *view)
        except TableNotFoundError:
            return None

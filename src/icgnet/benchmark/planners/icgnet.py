"""The network of this package, from the cloud to grasps that are checked against the predicted shapes."""

from dataclasses import replace

import numpy as np

from icgnet.benchmark.config import PlannerConfig
from icgnet.benchmark.observation import Observation, points_above_table, without_lonely_points
from icgnet.benchmark.planner import Plan
from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.depth_scale import levelled_depth
from icgnet.grasping.grasps import Grasps
from icgnet.inference.prediction import NO_INSTANCE, Prediction
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


def wanted_grasps(prediction: Prediction, observation: Observation) -> Grasps:
    """All grasps; if there is a target, those of the instance that has the most points in its pixels."""
    if observation.target is None:
        return prediction.grasps
    under = prediction.cloud_instances[observation.wanted(prediction.cloud.points)]
    counts = np.bincount(under[under != NO_INSTANCE], minlength=1)
    chosen = int(counts.argmax()) if counts.any() else NO_INSTANCE
    return prediction.grasps.select(prediction.grasps.instances == chosen)


class IcgNetPlanner:
    """Grasps of the predictor, the highest score first."""

    needs_truth = False

    def __init__(self, config: PlannerConfig) -> None:
        """Loads the network of a benchmark.

        Raises:
            DataError: the weights cannot be used.
            InputError: a hand that the weights do not know.
        """
        self._predictor = Predictor.load(config.weights, config.threads, config.gripper, search=config.search)
        self._level_table = config.level_table

    def plan(self, observation: Observation) -> Plan:
        """Grasps that touch nothing that was seen or is predicted; the prediction is in `details`."""
        cloud = observation.cloud
        if self._level_table and not observation.is_wide:
            cloud = cloud_on_table(observation)
        if len(cloud) == 0:
            return Plan.nothing()
        search = replace(self._predictor.search, opening="full" if observation.full_opening else "predicted")
        if observation.target is not None:
            search = replace(search, most=None)  # the first few grasps of all objects may be none of the target's
        seed = int(observation.rng.integers(2**31))
        predictor = Predictor(self._predictor.network, observation.gripper, search, seed=seed)
        if observation.is_wide:
            view = (observation.intrinsics, observation.T_world_camera)
            try:
                prediction = predictor.predict_depth(observation.depth, *view, observation.table_height)
            except TableNotFoundError:
                return Plan.nothing()
        else:
            prediction = predictor.predict_cloud(cloud.points, cloud.viewpoint, observation.table_height)
        grasps = wanted_grasps(prediction, observation)
        return Plan(grasps.poses, grasps.openings, grasps.scores, prediction)

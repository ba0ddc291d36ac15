"""The network of this package, from the cloud to grasps that are checked against the predicted shapes."""

from dataclasses import replace
from pathlib import Path

from icgnet.benchmark.observation import Observation
from icgnet.benchmark.planner import Plan
from icgnet.inference.grasp_search import BEST_FEW, GraspSearch
from icgnet.predictor import Predictor


class IcgNetPlanner:
    """Grasps of the predictor, the highest score first."""

    needs_truth = False

    def __init__(self, weights: Path | None = None, threads: int = 1, search: GraspSearch = BEST_FEW) -> None:
        """Loads the network.

        Args:
            weights: a file of weights; the shipped ones if None.
            threads: CPU threads of the network, for the whole process.
            search: how grasps are looked for; the opening is the observation's.

        Raises:
            DataError: the weights cannot be used.
            InputError: a number of threads below 1.
        """
        self._predictor = Predictor.load(weights, threads, search=search)

    def plan(self, observation: Observation) -> Plan:
        """Grasps that touch nothing that was seen or is predicted; the prediction is in `details`."""
        cloud, gripper = observation.cloud, observation.gripper
        if len(cloud) == 0:
            return Plan.nothing()
        search = replace(self._predictor.search, opening="full" if observation.full_opening else "predicted")
        predictor = Predictor(self._predictor.network, gripper, search)
        prediction = predictor.predict_cloud(cloud.points, cloud.viewpoint, observation.table_height)
        grasps = prediction.grasps
        return Plan(grasps.poses, grasps.openings, grasps.scores, prediction)

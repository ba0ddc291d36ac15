"""What a method must offer to be benchmarked."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from icgnet.benchmark.observation import Observation


@dataclass(frozen=True, eq=False)
class Plan:
    """Grasps that a planner proposes, the best one first; only that one is executed.

    Attributes:
        poses: T_world_grasp [m]: approach +z, closing axis +y, origin midway between the finger tips.
        openings: of the hand while it approaches [m].
        scores: the planner's trust in them.
        details: what else the planner found, for pictures; a `Prediction` if it is one.
    """

    poses: Float[np.ndarray, "g 4 4"]
    openings: Float[np.ndarray, "g"]
    scores: Float[np.ndarray, "g"]
    details: Any = None

    def __len__(self) -> int:
        return len(self.poses)

    @staticmethod
    def nothing(details: Any = None) -> "Plan":
        """No grasp was found."""
        return Plan(np.zeros((0, 4, 4)), np.zeros(0), np.zeros(0), details)


@runtime_checkable
class Planner(Protocol):
    """A method under test. It is made without arguments, once in every worker process.

    Attributes:
        needs_truth: whether it is to get the true scene, as no honest method would.
    """

    needs_truth: bool

    def plan(self, observation: Observation) -> Plan:
        """Grasps for what is on the table now."""
        ...

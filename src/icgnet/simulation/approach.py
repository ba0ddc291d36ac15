"""Whether an open hand reaches its grasp pose without touching anything, checked without any dynamics."""

# The compiled modules of mujoco carry no types.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from icgnet.geometry.transforms import matrix_to_quaternion
from icgnet.grasping.gripper import Gripper
from icgnet.simulation.config import Physics
from icgnet.simulation.hand import add_swept_hand
from icgnet.simulation.physics import Body, add_objects, new_spec
from icgnet.simulation.surroundings import ENDLESS, Surroundings

APPROACH_LENGTH = 0.05  # the hand comes in straight over this distance [m]
PARKED = 5.0  # height of hands that are not in use [m]


class ApproachChecker:
    """Fixed objects, the table with its surroundings, and several swept hands that are checked in one collision pass.

    Every box stands for all that it sweeps on its way in, so one pass checks the whole approach, without gaps.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        gripper: Gripper,
        physics: Physics,
        hands: int = 12,
        surroundings: Surroundings = ENDLESS,
    ) -> None:
        """Compiles the model.

        Args:
            bodies: the objects with their poses.
            gripper: the hand.
            physics: engine settings.
            hands: how many poses are checked in one pass.
            surroundings: the table or bin and what stands around it.
        """
        spec = new_spec(physics, surroundings)
        add_objects(spec, bodies, physics, movable=False)
        for index in range(hands):
            add_swept_hand(spec, gripper, f"hand_{index}", APPROACH_LENGTH)
        # One contact point a pair answers the question.
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_MULTICCD
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._hands = hands
        self._owner = np.full(self._model.ngeom, -1)
        for index in range(hands):
            root = self._model.body(f"hand_{index}").id
            self._owner[self._model.body_rootid[self._model.geom_bodyid] == root] = index

    def collides(self, poses: Float[np.ndarray, "g 4 4"], openings: Float[np.ndarray, "g"]) -> Bool[np.ndarray, "g"]:
        """Which hands touch an object or the table on their way to T_world_grasp, open by `openings` [m]."""
        result = np.zeros(len(poses), bool)
        for start in range(0, len(poses), self._hands):
            batch = slice(start, start + self._hands)
            result[batch] = self._pass(poses[batch], openings[batch])
        return result

    def _pass(self, poses: Float[np.ndarray, "g 4 4"], openings: Float[np.ndarray, "g"]) -> Bool[np.ndarray, "g"]:
        # A hand's coordinates: position, quaternion, two finger slides.
        qpos = self._data.qpos.reshape(self._hands, 9)
        qpos[:, :3] = [0.0, 0.0, PARKED]
        qpos[: len(poses), :3] = poses[:, :3, 3]
        qpos[: len(poses), 3:7] = matrix_to_quaternion(poses[:, :3, :3])
        qpos[: len(poses), 7:] = openings[:, None] / 2
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_collision(self._model, self._data)
        touching = self._owner[self._data.contact.geom[self._data.contact.dist < 0.0]]
        return np.isin(np.arange(len(poses)), touching)

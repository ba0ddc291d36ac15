"""A list of grasps."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True, eq=False)
class Grasps:
    """Parallel-jaw grasps in one frame: approach +z, closing axis +y, origin midway between the finger tips.

    Attributes:
        poses: T_frame_grasp.
        widths: distance between the finger tips when they hold the object [m].
        openings: distance between the finger tips on the way there [m]; the one that collisions are checked with.
        scores: success probability in [0, 1].
        instances: id of the instance that is grasped.
        contacts: contact point of the +y finger [m].
        angles: index of the approach angle at the contact, 0 to 11.
    """

    poses: Float[np.ndarray, "g 4 4"]
    widths: Float[np.ndarray, "g"]
    openings: Float[np.ndarray, "g"]
    scores: Float[np.ndarray, "g"]
    instances: Int[np.ndarray, "g"]
    contacts: Float[np.ndarray, "g 3"]
    angles: Int[np.ndarray, "g"]

    def __len__(self) -> int:
        return len(self.poses)

    def select(self, which: Int[np.ndarray, "k"] | Bool[np.ndarray, "g"] | slice) -> "Grasps":
        """The grasps at these indices, or where the mask is true."""
        return Grasps(
            self.poses[which],
            self.widths[which],
            self.openings[which],
            self.scores[which],
            self.instances[which],
            self.contacts[which],
            self.angles[which],
        )

    def sorted(self) -> "Grasps":
        """The same grasps, best score first; equal scores keep their order."""
        return self.select(np.argsort(-self.scores, kind="stable"))

    def transformed(self, T_a_b: Float[np.ndarray, "4 4"]) -> "Grasps":
        """The grasps of frame b in frame a."""
        contacts = self.contacts @ T_a_b[:3, :3].T + T_a_b[:3, 3]
        return replace(self, poses=T_a_b @ self.poses, contacts=contacts)

    @staticmethod
    def empty() -> "Grasps":
        """No grasps."""
        none = np.zeros(0)
        no_index = np.zeros(0, dtype=np.int64)
        return Grasps(np.zeros((0, 4, 4)), none, none, none, no_index, np.zeros((0, 3)), no_index)

    @staticmethod
    def concatenate(parts: Sequence["Grasps"]) -> "Grasps":
        """All grasps of the parts, in their order."""
        if not parts:
            return Grasps.empty()
        return Grasps(
            np.concatenate([p.poses for p in parts]),
            np.concatenate([p.widths for p in parts]),
            np.concatenate([p.openings for p in parts]),
            np.concatenate([p.scores for p in parts]),
            np.concatenate([p.instances for p in parts]),
            np.concatenate([p.contacts for p in parts]),
            np.concatenate([p.angles for p in parts]),
        )

"""One training scene as tensors, and how its labels are made from a view and the objects' poses."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from icgnet.network.hand_input import HandInput
from icgnet.network.inputs import SceneInput

NOTHING = -1
"""Instance of a voxel that belongs to none: table, flying pixels, objects of which too little is seen."""


@dataclass(frozen=True, eq=False)
class Sample:
    """What the network gets and what it should answer, for one view of one scene; workspace frame [m].

    Attributes:
        input: voxels and dense grid of the cloud.
        voxel_instances: [v] instance of every voxel, -1 for none.
        classes: [i] class index of every instance.
        occupancy_points: [n 3] where the shapes are asked for.
        occupancy: [i n] whether the point lies inside the instance.
        occupancy_asked: [n k] the instances that a point is asked of: the one whose surface is the nearest, or that the
            point is the deepest in, and another one by lot, if there is one.
        contacts: [g 3] contact points, on seen and unseen sides.
        normals: [g 3] outward unit normals there.
        contact_instances: [g] the instance that a contact lies on.
        contact_seen: [g] whether the cloud has a point next to the contact.
        labels: [g 12] 1 where the grasp from that angle succeeded.
        widths: [g] object width between the finger tips [m].
        hand: that the labels are true for.
    """

    input: SceneInput
    voxel_instances: Int[Tensor, "v"]
    classes: Int[Tensor, "i"]
    occupancy_points: Float[Tensor, "n 3"]
    occupancy: Bool[Tensor, "i n"]
    occupancy_asked: Int[Tensor, "n k"]
    contacts: Float[Tensor, "g 3"]
    normals: Float[Tensor, "g 3"]
    contact_instances: Int[Tensor, "g"]
    contact_seen: Bool[Tensor, "g"]
    labels: Float[Tensor, "g a"]
    widths: Float[Tensor, "g"]
    hand: HandInput

    @property
    def masks(self) -> Bool[Tensor, "i v"]:
        """Which voxels belong to which instance."""
        instances = torch.arange(len(self.classes), device=self.classes.device)
        return self.voxel_instances[None] == instances[:, None]

    def to(self, device: torch.device) -> "Sample":
        """The same sample on another device."""
        moved = {name: value.to(device) for name, value in vars(self).items() if isinstance(value, Tensor)}
        return replace(self, input=self.input.to(device), hand=self.hand.to(device), **moved)


def majority(
    owners: Int[np.ndarray, "n"], point_to_voxel: Int[np.ndarray, "n"], voxels: int, count: int
) -> Int[np.ndarray, "v"]:
    """The owner of most of a voxel's points: 0 to count - 1, or -1.

    Args:
        owners: owner of every point; anything below 0 is nobody.
        point_to_voxel: voxel of every point.
        voxels: number of voxels.
        count: number of owners.
    """
    column = np.where(owners < 0, count, owners)
    votes = np.bincount(point_to_voxel * (count + 1) + column, minlength=voxels * (count + 1))
    winner = votes.reshape(voxels, count + 1).argmax(axis=1)
    return np.where(winner == count, NOTHING, winner)


def renumber(
    voxel_owners: Int[np.ndarray, "v"], count: int, fewest: int, most: int | None
) -> tuple[Int[np.ndarray, "v"], Int[np.ndarray, "count"]]:
    """Instances of the voxels, numbered without gaps, and the instance of every object (-1 when it has none).

    Args:
        voxel_owners: object of every voxel, -1 for none.
        count: number of objects.
        fewest: voxels that an object must have to be an instance.
        most: number of instances at most, the ones with most voxels: a network may have only so many queries. None is
            any number.
    """
    voxels = np.bincount(voxel_owners[voxel_owners >= 0], minlength=count)
    rank = np.argsort(np.argsort(-voxels, kind="stable"))
    visible = (voxels >= fewest) & (rank < (count if most is None else most))
    instance_of_object = np.where(visible, np.cumsum(visible) - 1, NOTHING)
    # Index -1 reads the last entry, so nobody's voxels find the appended "nothing".
    return np.append(instance_of_object, NOTHING)[voxel_owners], instance_of_object


def choose_contacts(
    successful: Bool[np.ndarray, "g"],
    seen: Bool[np.ndarray, "g"],
    count: int,
    seen_share: float,
    rng: np.random.Generator,
) -> Int[np.ndarray, "c"]:
    """Indices of up to `count` contacts: half with a success at any angle where there are enough, the seen preferred.

    Args:
        successful: whether any angle of the contact succeeded.
        seen: whether the contact lies on a seen surface.
        count: how many contacts are wanted at most.
        seen_share: share that should lie on seen surfaces.
        rng: source of the draws.
    """
    # A random order in which unseen contacts come later; equal shares leave the order purely random.
    unseen_weight = (1.0 - seen_share) / max(seen_share, 1e-6)
    urgency = rng.exponential(size=len(seen)) / np.where(seen, 1.0, max(unseen_weight, 1e-6))
    order = np.argsort(urgency)
    good, bad = order[successful[order]], order[~successful[order]]
    from_good = min(len(good), max(count // 2, count - len(bad)))
    return np.concatenate([good[:from_good], bad[: count - from_good]])

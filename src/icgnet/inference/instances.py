"""The objects of a scene: encoded in one pass, whatever its extent, and told apart."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Int

from icgnet.geometry.cells import grid_around
from icgnet.geometry.visibility import visibility_grid
from icgnet.inference.tabletop import Tabletop
from icgnet.network.embedding import SceneEmbedding
from icgnet.network.icgnet import IcgNet
from icgnet.network.inputs import make_scene_input
from icgnet.network.instances import select_instances

SURROUNDINGS = 0.05
"""What cannot be an object is shown to the network where it is within the box around what can, and this far beyond it
[m]."""
MOST_POINTS, MOST_CELLS = 400_000, 1_000_000
"""Of scenes with more points, or a larger dense grid, what is farthest from the middle is left out: a table of
1.2 x 0.8 m has 100,000 points and 500,000 cells, and noise that fills space has more."""
MOSTLY = 0.5
"""An object has more than this share of its points where objects may be."""
FEWEST_POINTS = 10
"""What has fewer points there is none."""


@dataclass(frozen=True, eq=False)
class EncodedScene:
    """What the network knows of a scene.

    Attributes:
        rows: points of the tabletop's cloud that it was shown.
        point_to_voxel: voxel of each of them.
        embedding: the encoded scene, in the table frame.
        classes: names of the classes that the network knows, in the order of its logits.
    """

    rows: Int[np.ndarray, "n"]
    point_to_voxel: Int[np.ndarray, "n"]
    embedding: SceneEmbedding
    classes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Instance:
    """One object.

    Attributes:
        scene: that it was found in.
        query: the network's query for it.
        score: how sure the network is that this is one whole object, 0 to 1.
        class_name: most probable class.
        class_score: probability of that class, given that it is an object.
        rows: its points in the tabletop's cloud.
    """

    scene: EncodedScene
    query: int
    score: float
    class_name: str
    class_score: float
    rows: Int[np.ndarray, "n"]


@torch.no_grad()
def encode(network: IcgNet, tabletop: Tabletop, bfloat16: bool = False) -> tuple[EncodedScene | None, int]:
    """The encoded scene, None if nothing stands on the table; and how many points were left out for want of time.

    `bfloat16` computes the U-Nets in 16 bits.
    """
    if len(tabletop.standing) == 0:
        return None, 0
    around = _around(tabletop)
    rows = _affordable(tabletop, around)
    points, viewpoint = tabletop.cloud.points[rows], tabletop.cloud.viewpoint
    grid = grid_around(points)
    # Also things that the network is not shown hide what is behind them.
    above = tabletop.cloud.points[tabletop.above]
    visibility = None if viewpoint is None else visibility_grid(above, viewpoint, grid)
    scene, point_to_voxel = make_scene_input(points, network.config, visibility, viewpoint, grid)
    scene = scene.to(network.device)
    with torch.autocast(network.device.type, torch.bfloat16, enabled=bfloat16):
        embedding = network.encode([scene])[0]
    return EncodedScene(rows, point_to_voxel, embedding, network.config.classes), len(around) - len(rows)


def _around(tabletop: Tabletop) -> Int[np.ndarray, "n"]:
    """What may be an object, and what is around it."""
    points, standing = tabletop.cloud.points[tabletop.above], tabletop.cloud.points[tabletop.standing]
    lower, upper = standing.min(axis=0) - SURROUNDINGS, standing.max(axis=0) + SURROUNDINGS
    return tabletop.above[((points >= lower) & (points <= upper)).all(axis=1)]


def _affordable(tabletop: Tabletop, rows: Int[np.ndarray, "n"]) -> Int[np.ndarray, "m"]:
    """The points that are looked at: all, or those that are nearest to the middle of what may be an object."""
    points = tabletop.cloud.points[rows]
    standing = tabletop.cloud.points[tabletop.standing][:, :2]
    # The median itself may lie far from all, between two groups.
    middle = standing[np.abs(standing - np.median(standing, axis=0)).max(axis=1).argmin()]
    distance = np.abs(points[:, :2] - middle).max(axis=1)
    limit = np.inf if len(rows) <= MOST_POINTS else float(np.partition(distance, MOST_POINTS)[MOST_POINTS])
    while np.prod(grid_around(points[distance <= limit]).shape) > MOST_CELLS:
        limit = 0.9 * min(limit, float(distance.max()))
    return rows[distance <= limit]


def find_instances(scene: EncodedScene, tabletop: Tabletop) -> list[Instance]:
    """The objects of a scene, the one with most points first; what is no object stays out.

    Paper: instance masks and classes from the queries.
    """
    may_be_object: Bool[np.ndarray, "n"] = np.zeros(len(tabletop.cloud), dtype=bool)
    may_be_object[tabletop.standing] = True
    output = scene.embedding.stages[-1]
    found = select_instances(output)
    instances = []
    for query, score, mask in zip(
        found.queries.tolist(), found.scores.tolist(), found.masks.cpu().numpy(), strict=True
    ):
        rows = scene.rows[mask[scene.point_to_voxel]]
        own = rows[may_be_object[rows]]
        if len(own) < max(FEWEST_POINTS, MOSTLY * len(rows)):
            continue
        probabilities = torch.softmax(output.class_logits[query, :-1], dim=0)
        class_id = int(probabilities.argmax())
        instances.append(Instance(scene, query, score, scene.classes[class_id], float(probabilities[class_id]), own))
    return sorted(instances, key=lambda item: -len(item.rows))

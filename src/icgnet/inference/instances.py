"""The objects in the windows of a scene: encoded once, told apart, and each kept in one window only."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int

from icgnet.geometry.visibility import visibility_grid
from icgnet.inference.tabletop import Tabletop
from icgnet.inference.windows import Window, owners
from icgnet.network.embedding import SceneEmbedding
from icgnet.network.icgnet import IcgNet
from icgnet.network.inputs import make_scene_input
from icgnet.network.instances import select_instances

BATCH = 4
"""Windows that are encoded at once."""
MOST_VOXELS = 100_000
"""Of windows with more voxels together, those with the fewest points are left out: a table of 20 windows has so many,
and noise that fills space has more."""
SAME_IOU = 0.5
"""Two windows mean the same object when, of the points that both hold, their instances share more than this part."""
DUPLICATE_OVERLAP = 0.5
"""Two instances that share more than this part of the points of either one are the same object."""


@dataclass(frozen=True, eq=False)
class EncodedWindow:
    """What the network knows of one window.

    Attributes:
        window: where the cube is.
        rows: points of the tabletop's cloud in it.
        point_to_voxel: voxel of each of them.
        embedding: the encoded scene, in the frame of the window.
        classes: names of the classes that the network knows, in the order of its logits.
    """

    window: Window
    rows: Int[np.ndarray, "n"]
    point_to_voxel: Int[np.ndarray, "n"]
    embedding: SceneEmbedding
    classes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Instance:
    """One object as seen in one window.

    Attributes:
        view: the window that it was found in.
        query: the network's query for it.
        score: how sure the network is that this is one whole object, 0 to 1.
        class_name: most probable class.
        class_score: probability of that class, given that it is an object.
        rows: its points in the tabletop's cloud; a few may lie outside of the window.
    """

    view: EncodedWindow
    query: int
    score: float
    class_name: str
    class_score: float
    rows: Int[np.ndarray, "n"]


@torch.no_grad()
def encode_windows(
    network: IcgNet, tabletop: Tabletop, windows: list[Window], bfloat16: bool = False
) -> list[EncodedWindow]:
    """Embeddings of the windows that hold points; of more than `MOST_VOXELS`, those with most points.

    `bfloat16` computes the U-Nets in 16 bits.
    """
    standing = tabletop.cloud.points[tabletop.standing]
    inside = [tabletop.standing[window.inside(standing)] for window in windows]
    filled = [(window, rows) for window, rows in zip(windows, inside, strict=True) if len(rows)]
    above, viewpoint = tabletop.cloud.points[tabletop.above], tabletop.cloud.viewpoint
    prepared = []
    for window, rows in filled:
        points = window.to_window(tabletop.cloud.points[rows])
        # Also things outside of the cube hide what is in it.
        eye = None if viewpoint is None else window.to_window(viewpoint)
        visibility = None if eye is None else visibility_grid(window.to_window(above), eye)
        prepared.append(make_scene_input(points, network.config, visibility, eye))
    affordable = _affordable([len(rows) for _, rows in filled], [len(scene.voxels) for scene, _ in prepared])
    filled, prepared = [filled[index] for index in affordable], [prepared[index] for index in affordable]
    embeddings = []
    for start in range(0, len(prepared), BATCH):
        scenes = [scene.to(network.device) for scene, _ in prepared[start : start + BATCH]]
        with torch.autocast(network.device.type, torch.bfloat16, enabled=bfloat16):
            embeddings += network.encode(scenes)
    return [
        EncodedWindow(window, rows, point_to_voxel, embedding, network.config.classes)
        for (window, rows), (_, point_to_voxel), embedding in zip(filled, prepared, embeddings, strict=True)
    ]


def _affordable(points: list[int], voxels: list[int]) -> list[int]:
    """The windows that are looked at, in their order: by points, as many as `MOST_VOXELS` allows, one at least."""
    order = sorted(range(len(points)), key=lambda index: -points[index])
    total = np.cumsum([voxels[index] for index in order])
    count = max(1, int((total <= MOST_VOXELS).sum()))
    return sorted(order[:count])


def find_instances(views: list[EncodedWindow], points: Float[np.ndarray, "n 3"]) -> list[Instance]:
    """The objects of all windows, each once, the one with most points first.

    Args:
        views: the encoded windows.
        points: the tabletop's cloud [m].
    """
    found = [item for view in views for item in instances_of(view)]
    return keep_one_of_each(found, views, points) if found else []


def instances_of(view: EncodedWindow) -> list[Instance]:
    """The objects that one window shows.

    Paper: instance masks and classes from the queries.
    """
    output = view.embedding.stages[-1]
    found = select_instances(output)
    instances = []
    for query, score, mask in zip(
        found.queries.tolist(), found.scores.tolist(), found.masks.cpu().numpy(), strict=True
    ):
        probabilities = torch.softmax(output.class_logits[query, :-1], dim=0)
        class_id = int(probabilities.argmax())
        rows = view.rows[mask[view.point_to_voxel]]
        instances.append(Instance(view, query, score, view.classes[class_id], float(probabilities[class_id]), rows))
    return instances


def keep_one_of_each(
    found: list[Instance], views: list[EncodedWindow], points: Float[np.ndarray, "n 3"]
) -> list[Instance]:
    """The instances without those that another window shows better; no point belongs to two of them.

    A window knows best what lies in its core, so an object first belongs to the window whose middle is nearest to
    it; after that the more complete one counts. What sticks out of its window is added from the other windows.

    Args:
        found: instances of all windows; at least one.
        views: the encoded windows.
        points: the tabletop's cloud [m].
    """
    windows = [view.window for view in views]
    middles = np.array([points[item.rows].mean(axis=0) for item in found])
    at_home = [views[owner] is item.view for owner, item in zip(owners(windows, middles), found, strict=True)]
    order = sorted(range(len(found)), key=lambda i: (not at_home[i], -len(found[i].rows)))
    owner_of_point = np.full(len(points), -1)
    kept: list[Instance] = []
    for item in (found[index] for index in order):
        earlier = owner_of_point[item.rows]
        free = item.rows[earlier < 0]
        same = _same_object(item, kept, owner_of_point)
        if same is not None:
            owner_of_point[free[~np.isin(free, kept[same].view.rows)]] = same
        elif not _is_duplicate(item, earlier, kept):
            owner_of_point[free] = len(kept)
            kept.append(item)
    whole = [replace(item, rows=np.flatnonzero(owner_of_point == number)) for number, item in enumerate(kept)]
    return sorted(whole, key=lambda item: -len(item.rows))


def _same_object(item: Instance, kept: list[Instance], owner_of_point: Int[np.ndarray, "n"]) -> int | None:
    """The kept instance that agrees with this one on the points that both windows hold; None if there is none."""
    mine = owner_of_point[item.rows]
    theirs = owner_of_point[item.view.rows]
    for number in np.unique(mine[mine >= 0]):
        other = kept[number]
        if other.view is item.view:
            continue
        shared = int((mine == number).sum())
        either = int((theirs == number).sum()) + int(np.isin(item.rows, other.view.rows).sum()) - shared
        if shared > SAME_IOU * either:
            return int(number)
    return None


def _is_duplicate(item: Instance, earlier: Int[np.ndarray, "n"], kept: list[Instance]) -> bool:
    """Whether most of this instance's points belong to kept ones already, or most of a kept one's to it."""
    shared = np.bincount(earlier[earlier >= 0], minlength=len(kept))
    swallowed = shared > DUPLICATE_OVERLAP * np.array([len(other.rows) for other in kept])
    return bool(swallowed.any() or shared.sum() > DUPLICATE_OVERLAP * len(item.rows))

"""Slow and obvious versions of what the package does fast."""

import numpy as np
import torch


def normal_at(points, query, viewpoint, neighbours, radius):
    """Normal at one point: sort all points by distance, singular value decomposition of the nearest ones."""
    distance = np.linalg.norm(points - query, axis=1)
    nearest = [i for i in np.argsort(distance)[:neighbours] if distance[i] < radius]
    if len(nearest) < 3:
        return (viewpoint - query) / np.linalg.norm(viewpoint - query)
    normal = np.linalg.svd(points[nearest] - points[nearest].mean(axis=0))[2][2]
    return normal if normal @ (viewpoint - query) > 0 else -normal


def points_in_hand(pose, opening, gripper, points, margin):
    """How many points lie in a hand's boxes, one point and one box at a time."""
    count = 0
    for point in points:
        local = pose[:3, :3].T @ (point - pose[:3, 3])
        count += any(
            all(abs(local[k] - box.centre[k]) <= box.size[k] / 2 + margin for k in range(3))
            for box in gripper.boxes(opening)
        )
    return count


def hand_meets(pose, opening, gripper, inside, approach, spacing=0.003, steps=12):
    """Whether any of many points in the solid hand is inside something, at many places along the approach."""
    for back in np.linspace(0, approach, steps):
        for box in gripper.boxes(opening):
            counts = [int(np.ceil(edge / spacing)) + 1 for edge in box.size]
            axes = [c + np.linspace(-s / 2, s / 2, n) for c, s, n in zip(box.centre, box.size, counts, strict=True)]
            local = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) - [0, 0, back]
            if inside(local @ pose[:3, :3].T + pose[:3, 3]).any():
                return True
    return False


def dense_grid(coordinates, features):
    """Sparse features of one scene as a dense volume [1, c, x, y, z] with zeros elsewhere, and its lower corner."""
    lower = coordinates.amin(0)
    size = (coordinates.amax(0) - lower + 1).tolist()
    volume = features.new_zeros(features.shape[1], *size)
    x, y, z = (coordinates - lower).unbind(1)
    volume = volume.index_put((torch.arange(features.shape[1])[:, None], x[None], y[None], z[None]), features.t())
    return volume[None], lower


def submanifold_convolution(coordinates, features, weight, kernel, dilation):
    """Convolution of one scene by `conv3d` on the whole volume, read at the voxels that are there."""
    volume, lower = dense_grid(coordinates, features)
    dense_weight = weight.view(kernel, kernel, kernel, *weight.shape[1:]).permute(4, 3, 0, 1, 2)
    result = torch.nn.functional.conv3d(volume, dense_weight, padding=kernel // 2 * dilation, dilation=dilation)
    x, y, z = (coordinates - lower).unbind(1)
    return result[0, :, x, y, z].t()

"""Poses of frames from the transforms that come in over /tf and /tf_static."""

from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from icgnet.errors import InputError
from icgnet.geometry.transforms import invert_transform, make_transform, quaternion_to_matrix

if TYPE_CHECKING:
    from icgnet.ros2.messages import TransformStamped

NANOSECONDS = 1_000_000_000
KEPT = 10 * NANOSECONDS
"""Older transforms of a moving frame are forgotten, as tf2 does [ns]."""
MOST_FRAMES = 1000
"""Deeper trees are loops."""


@dataclass(frozen=True, eq=False)
class Placed:
    """Pose of a frame in its parent at a time.

    Attributes:
        time: when [ns].
        parent: name of the parent.
        T_parent_child: the pose [m].
    """

    time: int
    parent: str
    T_parent_child: Float[np.ndarray, "4 4"]


class Frames:
    """The tree of frames, and how each has moved in the last seconds.

    Args:
        tolerance: how far from the asked time the nearest transform of a moving frame may be [s].
    """

    def __init__(self, tolerance: float = 0.1) -> None:
        self.tolerance = tolerance
        self._fixed: dict[str, Placed] = {}
        self._moving: dict[str, list[Placed]] = {}

    def add(self, transforms: Iterable["TransformStamped"], is_fixed: bool) -> None:
        """Takes in transforms; those whose numbers are no pose are left out, as tf2 does.

        Args:
            transforms: of one message.
            is_fixed: whether they hold for all times, as those of /tf_static.
        """
        for each in transforms:
            child, placed = _name(each.child_frame_id), _placed(each)
            if placed is None or child == placed.parent:
                continue
            if is_fixed:
                self._fixed[child] = placed
                continue
            history = self._moving.setdefault(child, [])
            history.insert(bisect_left(history, placed.time, key=lambda known: known.time), placed)
            if history[-1].time < placed.time - KEPT or placed.time < history[-1].time - KEPT:
                history[:] = [placed]  # the clock was set back, as when a recording starts anew
            del history[: bisect_left(history, history[-1].time - KEPT, key=lambda known: known.time)]

    def pose(self, target: str, source: str, time: int) -> Float[np.ndarray, "4 4"]:
        """`T_target_source` at this time [ns]; 0 is the newest that is known.

        Raises:
            InputError: a frame is not known, they are not connected, or nothing is known of that time.
        """
        target, source = _name(target), _name(source)
        down = self._way_up(source, time)
        up = self._way_up(target, time)
        common = next((name for name in down if name in up), None)
        if common is None:
            known = sorted({*self._fixed, *self._moving, *(placed.parent for placed in self._all())})
            missing = [name for name in (target, source) if name not in known]
            reason = f"{' and '.join(map(repr, missing))} not known" if missing else "not connected"
            have = ", ".join(known[:12]) + (", ..." if len(known) > 12 else "") if known else "none yet"
            raise InputError(f"no transform from {source!r} to {target!r}: {reason}; frames of /tf are {have}")
        return invert_transform(up[common]) @ down[common]

    def _way_up(self, name: str, time: int) -> dict[str, Float[np.ndarray, "4 4"]]:
        """Each frame from this one to the root, and the pose of this one in it."""
        pose = np.eye(4)
        way = {name: pose}
        while len(way) < MOST_FRAMES and (placed := self._at(name, time)) is not None:
            name, pose = placed.parent, placed.T_parent_child @ pose
            if name in way:
                raise InputError(f"the frames of /tf make a loop at {name!r}")
            way[name] = pose
        return way

    def _at(self, child: str, time: int) -> Placed | None:
        """Where a frame was; between two known times on the way from one to the other."""
        history = self._moving.get(child)
        if history is None:
            return self._fixed.get(child)
        if time == 0:
            return history[-1]
        after = bisect_left(history, time, key=lambda known: known.time)
        near = history[max(0, after - 1) : after + 1]
        if len(near) == 2:
            return _between(near[0], near[1], time)
        (nearest,) = near
        off = (time - nearest.time) / NANOSECONDS
        if abs(off) > self.tolerance:
            age = f"{abs(off):.2f} s {'older' if off > 0 else 'newer'} than the image"
            raise InputError(f"the {'newest' if off > 0 else 'oldest'} transform of {child!r} is {age}")
        return nearest

    def _all(self) -> Iterable[Placed]:
        yield from self._fixed.values()
        for history in self._moving.values():
            yield from history


def nanoseconds(sec: int, nanosec: int) -> int:
    """A time stamp as one number [ns]."""
    return NANOSECONDS * sec + nanosec


def _name(frame_id: str) -> str:
    """The name of a frame without the slash that ROS 1 put before it."""
    return frame_id.removeprefix("/")


def _placed(message: "TransformStamped") -> Placed | None:
    move, turn = message.transform.translation, message.transform.rotation
    quaternion = np.array([turn.w, turn.x, turn.y, turn.z])
    position = np.array([move.x, move.y, move.z])
    length = np.linalg.norm(quaternion)
    if not message.child_frame_id or not np.isfinite(position).all() or not abs(length - 1.0) < 0.01:
        return None
    stamp = message.header.stamp
    pose = make_transform(quaternion_to_matrix(quaternion / length), position)
    return Placed(nanoseconds(stamp.sec, stamp.nanosec), _name(message.header.frame_id), pose)


def _between(first: Placed, second: Placed, time: int) -> Placed:
    """The pose at a time between two: straight in position, and at an even speed in direction."""
    from scipy.spatial.transform import Rotation, Slerp

    if first.parent != second.parent or first.time == second.time:
        return second
    share = (time - first.time) / (second.time - first.time)
    a, b = first.T_parent_child, second.T_parent_child
    turn = Slerp([0.0, 1.0], Rotation.from_matrix(np.stack([a[:3, :3], b[:3, :3]])))(share).as_matrix()
    return Placed(time, first.parent, make_transform(turn, (1 - share) * a[:3, 3] + share * b[:3, 3]))

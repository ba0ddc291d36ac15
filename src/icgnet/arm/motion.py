"""What moves how during a pick, as a film: rigid parts and their poses over time. Needs no package for arms."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import trimesh
from jaxtyping import Bool, Float

from icgnet.errors import DataError
from icgnet.geometry.transforms import make_transform, matrix_to_quaternion, quaternion_to_matrix

FORMAT = "icgnet motion 1"
MOTION_FILE = "motion.npz"
Kind = Literal["support", "background", "object", "arm", "hand"]


@dataclass(frozen=True, eq=False)
class MovingPart:
    """A rigid thing.

    Attributes:
        name: of it.
        kind: what it is.
        instance: id of an object, -1 of what is none.
        mesh: its surface in its own frame [m].
        poses: of that frame in the world, one for each moment; a single one if it stands still.
        shown: whether it is there, for each moment, or once if that does not change.
    """

    name: str
    kind: Kind
    instance: int
    mesh: trimesh.Trimesh
    poses: Float[np.ndarray, "n 4 4"]
    shown: Bool[np.ndarray, "m"]

    @property
    def moves(self) -> bool:
        """Whether anything of it changes."""
        return len(self.poses) > 1 or len(self.shown) > 1

    def at(self, moment: int) -> Float[np.ndarray, "4 4"] | None:
        """Its pose in the world at a moment; None while it is not there."""
        if not self.shown[min(moment, len(self.shown) - 1)]:
            return None
        return self.poses[min(moment, len(self.poses) - 1)]


@dataclass(frozen=True, eq=False)
class Motion:
    """A pick in a world with z up.

    Attributes:
        title: what is picked.
        times: of the moments, from 0 [s].
        parts: everything that is there.
        phase_ends: when each phase ends [s].
        captions: of the phases: their names, and how near to what anything comes.
    """

    title: str
    times: Float[np.ndarray, "n"]
    parts: tuple[MovingPart, ...]
    phase_ends: Float[np.ndarray, "p"]
    captions: tuple[str, ...]

    @property
    def duration(self) -> float:
        """From start to end [s]."""
        return float(self.times[-1])

    def moment(self, time: float) -> int:
        """Number of the moment nearest to a time [s]."""
        return int(np.abs(self.times - time).argmin())

    def caption(self, time: float) -> str:
        """Of the phase at a time [s]; at its end it is still that phase."""
        return self.captions[min(int(np.searchsorted(self.phase_ends, time)), len(self.captions) - 1)]

    def write(self, path: Path) -> None:
        """Writes everything into one npz file."""
        parts = self.parts
        poses = [part.poses for part in parts]
        places = [np.concatenate([each[:, :3, 3], matrix_to_quaternion(each[:, :3, :3])], axis=1) for each in poses]
        arrays = {
            "vertices": [np.asarray(part.mesh.vertices, np.float32) for part in parts],
            "faces": [np.asarray(part.mesh.faces, np.int32) for part in parts],
            "poses": [each.astype(np.float32) for each in places],
            "shown": [part.shown for part in parts],
        }
        content: dict[str, Any] = {
            "format": FORMAT,
            "title": self.title,
            "times": self.times,
            "phase_ends": self.phase_ends,
            "captions": np.array(self.captions),
            "names": np.array([part.name for part in parts]),
            "kinds": np.array([part.kind for part in parts]),
            "instances": np.array([part.instance for part in parts]),
        }
        content |= {name: np.concatenate(each) for name, each in arrays.items()}
        content |= {f"{name}_counts": np.array([len(rows) for rows in each]) for name, each in arrays.items()}
        np.savez_compressed(path, **content)

    @staticmethod
    def load(path: Path) -> "Motion":
        """The motion of a file that `write` wrote.

        Raises:
            DataError: it cannot be read, or holds something else.
        """
        try:
            with np.load(path) as saved:
                return _assemble(dict(saved))
        except Exception as error:  # there is no end to what a broken file can raise
            reason = " ".join(str(error).split())[:200]
            raise DataError(f"{path} is not a saved motion: {type(error).__name__} {reason}") from error


def _assemble(saved: dict[str, Any]) -> Motion:
    if str(saved["format"]) != FORMAT:
        raise DataError(f"format {str(saved['format'])[:40]!r} is not {FORMAT!r}: plan again")
    count = len(saved["names"])
    split = partial(_split, saved, count)
    parts = []
    for name, kind, instance, vertices, faces, places, shown in zip(
        saved["names"],
        saved["kinds"],
        saved["instances"],
        *map(split, ("vertices", "faces", "poses", "shown")),
        strict=True,
    ):
        if str(kind) not in get_args(Kind) or not len(places) or not len(shown):
            raise DataError(f"part {str(name)[:40]} is none")
        mesh = trimesh.Trimesh(vertices.astype(float), faces, process=False)
        poses = make_transform(quaternion_to_matrix(places[:, 3:]), places[:, :3])
        parts.append(MovingPart(str(name), str(kind), int(instance), mesh, poses, shown.astype(bool)))  # pyright: ignore
    captions = tuple(map(str, saved["captions"]))
    times, ends = saved["times"].astype(float), saved["phase_ends"].astype(float)
    if not len(times) or not captions or len(captions) != len(ends):
        raise DataError("it has no moments or no phases")
    return Motion(str(saved["title"]), times, tuple(parts), ends, captions)


def _split(saved: dict[str, Any], count: int, name: str) -> list[np.ndarray]:
    """The rows of each part."""
    counts = saved[f"{name}_counts"]
    if len(counts) != count or counts.sum() != len(saved[name]):
        raise DataError(f"{name} are not those of {count} parts")
    return np.split(saved[name], np.cumsum(counts)[:-1])

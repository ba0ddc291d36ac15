"""Settings of the simulation; nothing heavy is imported here."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from icgnet.settings import check_range


@dataclass(frozen=True)
class Physics:
    """Settings of the physics engine and of the materials; the friction pairs are those of the published benchmark."""

    timestep: float = 0.004
    """[s]; at most 0.004."""
    impratio: float = 100.0
    """Stiffness of friction relative to the normal direction; high values keep held objects from creeping."""
    object_mass: float = 0.5
    """Of every object, whatever its size [kg]; drawn anew for each scene that is labelled."""
    object_friction: float = 1.0
    """Sliding friction of object on object and object on palm."""
    table_friction: float = 0.5
    """Sliding friction of anything on the table and on the drop box."""
    pad_friction: float | None = None
    """Sliding friction of the finger pads on objects, None for the gripper's own; drawn anew for labels."""
    pad_torsion: float = 0.05
    """Torsional friction of the finger pads [m]."""

    def __post_init__(self) -> None:
        check_range(self, 0.0, "timestep", above=True, most=0.004)
        check_range(self, 0.0, "impratio", "object_mass", above=True)
        check_range(self, 0.0, "object_friction", "table_friction", "pad_friction", "pad_torsion")


@dataclass(frozen=True)
class Jitter:
    """What a grasp must survive, drawn anew for every trial."""

    contact: float = 0.0015
    """Standard deviation of the contact position along each axis [m]."""
    normal: float = math.radians(4.0)
    """Standard deviation of the normal about each tangent [rad]."""

    def __post_init__(self) -> None:
        check_range(self, 0.0, "contact", "normal")

    def apply(
        self, positions: Float[np.ndarray, "*n 3"], normals: Float[np.ndarray, "*n 3"], rng: np.random.Generator
    ) -> tuple[Float[np.ndarray, "*n 3"], Float[np.ndarray, "*n 3"]]:
        """Positions [m] and unit normals as an imperfect perception would give them."""
        shifted = positions + rng.normal(scale=self.contact, size=positions.shape)
        return shifted, _tilt(normals, rng.normal(scale=self.normal, size=normals.shape))


def _tilt(normals: Float[np.ndarray, "*n 3"], tilts: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Unit normals, turned a little: the tangential part of `tilts` [rad] is added to them."""
    tangent = tilts - (tilts * normals).sum(axis=-1, keepdims=True) * normals
    tilted = normals + tangent
    return tilted / np.linalg.norm(tilted, axis=-1, keepdims=True)

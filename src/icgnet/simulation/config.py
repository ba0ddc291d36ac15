"""Settings of the simulation; nothing heavy is imported here."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from icgnet.errors import InputError
from icgnet.objects.kinds import CUBE_KINDS, Kind
from icgnet.settings import check_range


@dataclass(frozen=True)
class Physics:
    """Settings of the physics engine and of the materials; the friction pairs are those of the published benchmark."""

    timestep: float = 0.004
    """[s]; at most 0.004."""
    impratio: float = 100.0
    """Stiffness of friction relative to the normal direction; high values keep held objects from creeping."""
    object_mass: float | None = 0.5
    """Of every object, whatever its size [kg]; None to weigh them by `density`. Drawn anew for each scene of the cube
    that is labelled."""
    density: float = 400.0
    """Of what objects are made of [kg/m^3], within 20 g and 1 kg an object; where `object_mass` is None."""
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
        check_range(self, 0.0, "impratio", "object_mass", "density", above=True)
        check_range(self, 0.0, "object_friction", "table_friction", "pad_friction", "pad_torsion")


def default_physics(kind: Kind) -> Physics:
    """The published settings for scenes in the cube; in wide ones, with large and small things, density decides."""
    return Physics() if kind in CUBE_KINDS else Physics(object_mass=None)


LARGEST_PART = 0.8
"""Of the shorter side of a table or bin, which an object may be long."""


@dataclass(frozen=True)
class WideScenes:
    """Ranges from which tables and bins, and the objects on and in them, are drawn."""

    objects: tuple[int, int] = (3, 25)
    """Objects to try for; fewer where the support is small."""
    table_edge: tuple[float, float] = (0.4, 1.2)
    """Of a table top, either way [m]."""
    bin_edge: tuple[float, float] = (0.25, 0.6)
    """Of the floor of a bin, either way [m]."""
    bin_height: tuple[float, float] = (0.05, 0.25)
    """Of the walls of a bin [m]."""
    bin_slope_deg: tuple[float, float] = (3.0, 25.0)
    """How far the walls of every other bin lean outwards [degrees]; those of the rest are upright."""
    scale: tuple[float, float] = (0.7, 1.6)
    """Factor on every object."""
    stretch: float = 0.15
    """Largest further factor, as a part of 1, along one axis of every other object."""
    longest: tuple[float, float] = (0.02, 0.30)
    """Longest side of an object after that [m]."""
    stored: float = 0.3
    """Share of the scenes that have boxes alone, on and beside one another as goods are stored: what no pile of small
    things teaches."""

    def __post_init__(self) -> None:
        ranges = ("objects", "table_edge", "bin_edge", "bin_height", "bin_slope_deg", "scale", "longest")
        for name in ranges:
            lower, upper = getattr(self, name)
            least = 0.0 if name == "bin_slope_deg" else 1e-3
            if not least <= lower <= upper:
                raise InputError(f"{name} must be a range of numbers from {least:g} on, got ({lower}, {upper})")
        check_range(self, 0.0, "stretch", most=0.5)
        check_range(self, 0.0, "stored", most=1.0)
        for name in ("table_edge", "bin_edge"):
            if getattr(self, name)[0] < 2 * self.longest[0]:
                raise InputError(
                    f"{name} begins at {getattr(self, name)[0]:g} m, which is too small for objects of "
                    f"{self.longest[0]:g} m (longest)"
                )

    def takes(self, kind: Kind, sides: tuple[float, float, float]) -> bool:
        """Whether there are a scale and a stretch at which an object may stand on the largest support.

        Args:
            kind: "table" or "bin".
            sides: of the box around the object at scale 1 [m].
        """
        edge = self.table_edge[1] if kind == "table" else self.bin_edge[1]
        longest = max(sides)
        # A stretch changes one side only.
        shortened = max(sorted(sides)[1], (1.0 - self.stretch) * longest)
        largest = min(self.longest[1], LARGEST_PART * edge)
        return (
            self.scale[0] * shortened <= largest and self.scale[1] * (1.0 + self.stretch) * longest >= self.longest[0]
        )


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

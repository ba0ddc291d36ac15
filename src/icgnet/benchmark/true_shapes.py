"""The true shapes of a scene: what is inside of them, and which of them a measured point belongs to."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh
from jaxtyping import Float, Int

from icgnet.objects.classes import known_class
from icgnet.objects.object_set import ObjectSet
from icgnet.simulation.scene import Scene, world_mesh

NO_OBJECT = -1
"""Owner of a point that is far from every object: noise."""
NEAR = 0.01
"""A measured point belongs to the nearest object within this distance [m]."""


@dataclass(frozen=True)
class NamedObject:
    """An object that really stands there.

    Attributes:
        name: key in its set.
        class_name: its class.
        alternative: the class that it could have had as well, by those who labelled it; None where it is clear.
    """

    name: str
    class_name: str
    alternative: str | None = None

    def known_to(self, classes: Sequence[str]) -> "NamedObject":
        """The same for weights of these classes: what they do not know is "other" for them.

        Raises:
            InputError: they do not know "other", either.
        """
        alternative = self.alternative and known_class(self.alternative, classes)
        return NamedObject(self.name, known_class(self.class_name, classes), alternative)


class TrueShapes:
    """The objects of a scene, asked in the world frame [m].

    Args:
        scene: what stands there.
        object_set: of the scene.
        target: index of the one object that is to be grasped; None if any will do.
    """

    def __init__(self, scene: Scene, object_set: ObjectSet, target: int | None = None) -> None:
        self.scene = scene
        self.object_set = object_set
        self.target = target

    def __len__(self) -> int:
        return len(self.scene.objects)

    @property
    def objects(self) -> tuple[NamedObject, ...]:
        """What each object is called."""
        names, known = [placed.name for placed in self.scene.objects], self.object_set
        return tuple(NamedObject(name, known.class_name(name), known.class_alternative(name)) for name in names)

    @cached_property
    def meshes(self) -> tuple[trimesh.Trimesh, ...]:
        """Visual mesh of each object, with whatever is drawn inside of it."""
        return tuple(world_mesh(placed, self.object_set) for placed in self.scene.objects)

    def distance(self, index: int, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Signed distance of points to one object [m], negative inside."""
        placed = self.scene.objects[index]
        grid = self.object_set.signed_distance(placed.name)
        return grid.distance_from(points, placed.T_world_object, placed.factors)

    def distances(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "i n"]:
        """Signed distance of points to every object [m], negative inside."""
        return np.array([self.distance(index, points) for index in range(len(self))]).reshape(len(self), len(points))

    def owners(self, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "n"]:
        """Index of the object nearest to each measured point, `NO_OBJECT` if none is near."""
        if len(self) == 0:
            return np.full(len(points), NO_OBJECT)
        # A point just below one surface is not nearer to it than one just above another.
        distances = np.abs(self.distances(points))
        return np.where(distances.min(axis=0) < NEAR, distances.argmin(axis=0), NO_OBJECT)

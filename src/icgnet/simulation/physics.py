"""The parts of a MuJoCo model that every world shares: table, surroundings, drop box, objects."""

# The compiled modules of mujoco carry no types.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from icgnet.geometry.transforms import matrix_to_quaternion
from icgnet.geometry.workspace import CENTRE, TABLE_HEIGHT
from icgnet.objects.model import ObjectModel
from icgnet.objects.object_set import ObjectSet
from icgnet.simulation.config import Physics
from icgnet.simulation.scene import Scene
from icgnet.simulation.surroundings import ENDLESS, Surroundings

# Contact parameters: a stiff contact (time constant two steps) that sinks in by a fraction of a millimetre.
CONTACT_SOLIMP = (0.95, 0.99, 0.001, 0.5, 2.0)
# Where two surfaces meet, the one with the higher priority decides on friction: pad, then table, then object.
TABLE_PRIORITY, PAD_PRIORITY = 1, 2
# The published drop box: inner edges of its walls, their thickness and height above the table [m].
BOX_LOWER, BOX_UPPER, BOX_WALL, BOX_HEIGHT = 0.0239, 0.2761, 0.02, 0.13
TABLE_THICKNESS = 0.1  # of a table with edges, for the physics [m]
LIGHTEST, HEAVIEST = 0.02, 1.0  # objects that are weighed by their density [kg]


@dataclass(frozen=True, eq=False)
class Body:
    """An object model, scaled, stretched and posed in the world [m]."""

    model: ObjectModel
    scale: float
    T_world_object: Float[np.ndarray, "4 4"]
    stretch: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def factors(self) -> Float[np.ndarray, "3"]:
        """Scale and stretch along the axes of the model."""
        return self.scale * np.array(self.stretch)

    def density(self, physics: Physics) -> float:
        """Mass by volume of its convex parts [kg/m^3]."""
        parts = sum(abs(part.volume) for part in self.model.parts)
        volume = parts * self.scale**3 * float(np.prod(self.stretch))
        if physics.object_mass is not None:
            return physics.object_mass / volume
        return float(np.clip(physics.density * volume, LIGHTEST, HEAVIEST)) / volume


def scene_bodies(scene: Scene, object_set: ObjectSet) -> list[Body]:
    """The objects of a scene."""
    return [
        Body(object_set.model(placed.name), placed.scale, placed.T_world_object, placed.stretch)
        for placed in scene.objects
    ]


def new_spec(physics: Physics, surroundings: Surroundings = ENDLESS) -> mujoco.MjSpec:
    """An empty model with our solver options, the table, and the structures around it (structure_0, ...)."""
    spec = mujoco.MjSpec()
    spec.option.timestep = physics.timestep
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = physics.impratio
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.memory = 64 * 2**20
    _add_table(spec, physics, surroundings)
    for index, structure in enumerate(surroundings.structures):
        surface = structure.mesh()
        mesh = spec.add_mesh(name=f"structure_mesh_{index}")
        mesh.uservert, mesh.userface = surface.vertices.ravel(), surface.faces.ravel()
        spec.worldbody.add_geom(
            name=f"structure_{index}",
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=mesh.name,
            priority=TABLE_PRIORITY,
            **contact_settings(physics, physics.table_friction),
        )
    return spec


def _add_table(spec: mujoco.MjSpec, physics: Physics, surroundings: Surroundings) -> None:
    settings = {"name": "table", "priority": TABLE_PRIORITY, **contact_settings(physics, physics.table_friction)}
    if surroundings.extent is None:
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[1.0, 1.0, 0.1],
            pos=[CENTRE[0], CENTRE[1], TABLE_HEIGHT],
            **settings,
        )
        return
    lower, upper = np.array(surroundings.extent[:2]), np.array(surroundings.extent[2:])
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[*((upper - lower) / 2), TABLE_THICKNESS / 2],
        pos=[*((lower + upper) / 2), TABLE_HEIGHT - TABLE_THICKNESS / 2],
        **settings,
    )


def contact_settings(physics: Physics, sliding: float, torsion: float = 0.005) -> dict[str, object]:
    """Friction and stiffness of a geom, as keyword arguments of `add_geom`."""
    return {
        "friction": [sliding, torsion, 0.0001],
        "condim": 4,
        "solref": [2.0 * physics.timestep, 1.0],
        "solimp": list(CONTACT_SOLIMP),
    }


def add_drop_box(spec: mujoco.MjSpec, physics: Physics) -> None:
    """Adds the four walls of the published drop box, named wall_0 to wall_3."""
    middle, half, wall = (BOX_LOWER + BOX_UPPER) / 2, (BOX_UPPER - BOX_LOWER) / 2, BOX_WALL / 2
    for index, (x, y) in enumerate([(1, 0), (-1, 0), (0, 1), (0, -1)]):
        spec.worldbody.add_geom(
            name=f"wall_{index}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[middle + x * (half + wall), middle + y * (half + wall), TABLE_HEIGHT + BOX_HEIGHT / 2],
            size=[half + 2 * wall if y else wall, half + 2 * wall if x else wall, BOX_HEIGHT / 2],
            priority=TABLE_PRIORITY,
            **contact_settings(physics, physics.table_friction),
        )


def add_objects(spec: mujoco.MjSpec, bodies: Sequence[Body], physics: Physics, movable: bool) -> None:
    """Adds every object as a body object_0, object_1, ... made of its convex parts, free to move or fixed."""
    for index, body in enumerate(bodies):
        pose = body.T_world_object
        placed = spec.worldbody.add_body(
            name=f"object_{index}", pos=pose[:3, 3], quat=matrix_to_quaternion(pose[:3, :3])
        )
        if movable:
            placed.add_freejoint()
            # MuJoCo leaves gravity compensation out of models that begin without; `World` turns it on and off.
            placed.gravcomp = 1.0
        density = body.density(physics)
        for number, part in enumerate(body.model.parts):
            mesh = spec.add_mesh(name=f"mesh_{index}_{number}")
            mesh.uservert = (part.vertices * body.factors).ravel()
            mesh.userface = part.faces.ravel()
            placed.add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=mesh.name,
                density=density,
                **contact_settings(physics, physics.object_friction),
            )

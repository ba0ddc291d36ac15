"""The gripper in MuJoCo: a free-floating hand that follows a mocap body, and a swept hand for collision checks."""

# The compiled modules of mujoco carry no types.
# pyright: reportAttributeAccessIssue=false

import mujoco

from icgnet.grasping.gripper import Box, Gripper
from icgnet.simulation.config import Physics
from icgnet.simulation.physics import PAD_PRIORITY, contact_settings

PALM_MASS, FINGER_MASS = 0.8, 0.1
# The fingers close with full force against a damping that gives them this speed [m/s]: the Franka hand's limit.
CLOSING_SPEED = 0.2
# Reflected inertia of the drive [kg]: fingers as light as their shells would bounce off what they hit.
FINGER_ARMATURE = 0.5
SIDES = (("left", 1.0), ("right", -1.0))


def add_hand(spec: mujoco.MjSpec, gripper: Gripper, physics: Physics) -> None:
    """Adds a hand whose body frame is the grasp frame, held by a stiff spring to the mocap body `hand_target`.

    Bodies: hand, finger_left (+y), finger_right. Each finger has a slide joint (half of the opening) and a motor.
    """
    hand = spec.worldbody.add_body(name="hand", pos=[0.0, 0.0, 2.0], gravcomp=1.0)
    hand.add_freejoint()
    fill_hand(spec, hand, gripper, physics)
    _add_target(spec, physics)
    couple_fingers(spec, physics)


def fill_hand(spec: mujoco.MjSpec, hand: "mujoco.MjsBody", gripper: Gripper, physics: Physics) -> None:
    """Gives the body of a hand its palm and fingers with their motors, see `add_hand`."""
    for box in gripper.palm:
        _add_box(hand, box, PALM_MASS / len(gripper.palm), contact_settings(physics, physics.object_friction))
    friction = gripper.friction if physics.pad_friction is None else physics.pad_friction
    for side, sign in SIDES:
        finger = hand.add_body(name=f"finger_{side}", gravcomp=1.0)
        finger.add_joint(
            name=f"slide_{side}",
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[0.0, sign, 0.0],
            range=[0.0, gripper.max_opening / 2],
            limited=True,
            damping=[gripper.finger_force / CLOSING_SPEED, 0.0, 0.0],
            armature=FINGER_ARMATURE,
        )
        for box in gripper.finger:
            settings = contact_settings(physics, friction, physics.pad_torsion)
            _add_box(
                finger, box if sign > 0 else box.mirrored(), FINGER_MASS / len(gripper.finger), settings, PAD_PRIORITY
            )
        spec.add_actuator(
            name=f"motor_{side}",
            target=f"slide_{side}",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            ctrlrange=[-gripper.finger_force, gripper.finger_force],
            ctrllimited=True,
        )


def closing_time(gripper: Gripper) -> float:
    """How long the fingers move from the largest opening until they meet [s]."""
    return gripper.max_opening / 2 / CLOSING_SPEED


def _add_target(spec: mujoco.MjSpec, physics: Physics) -> None:
    spec.worldbody.add_body(name="hand_target", mocap=True, pos=[0.0, 0.0, 2.0])
    weld = spec.add_equality(
        type=mujoco.mjtEq.mjEQ_WELD,
        name1="hand_target",
        name2="hand",
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        solref=_stiff(physics),
    )
    # Anchor at the origin, identity relative pose, equal weight of rotation and translation.
    weld.data[:11] = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1]


def couple_fingers(spec: mujoco.MjSpec, physics: Physics) -> None:
    """Lets both fingers of a hand move alike; the last thing to be added to it."""
    gear = spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT,
        name1="slide_left",
        name2="slide_right",
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        solref=_stiff(physics),
    )
    gear.data[:5] = [0, 1, 0, 0, 0]


def _stiff(physics: Physics) -> list[float]:
    return [2.0 * physics.timestep, 1.0]


def add_swept_hand(spec: mujoco.MjSpec, gripper: Gripper, name: str, approach: float) -> None:
    """Adds a hand whose boxes cover a straight approach of this length [m], without any dynamics.

    All boxes are parallel to the approach axis, so the volume that a box sweeps is again a box: one collision check
    at the final pose stands for the whole way there.
    """
    hand = spec.worldbody.add_body(name=name)
    hand.add_freejoint()
    for box in gripper.palm:
        _add_box(hand, box.swept(approach), PALM_MASS, SWEPT_MASK)
    for side, sign in SIDES:
        finger = hand.add_body(name=f"{name}_{side}")
        finger.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, sign, 0.0])
        for box in gripper.finger:
            _add_box(finger, (box if sign > 0 else box.mirrored()).swept(approach), FINGER_MASS, SWEPT_MASK)


# Swept hands see objects and table (whose masks stay 1 and 1), but not each other.
SWEPT_MASK: dict[str, object] = {"contype": 1, "conaffinity": 0}


def _add_box(body, box: Box, mass: float, settings: dict[str, object], priority: int = 0) -> None:
    half = [edge / 2 for edge in box.size]
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, pos=list(box.centre), size=half, mass=mass, priority=priority, **settings
    )

"""Definitions of the messages in Jazzy, by a library that is not ours, and messages with random contents."""

import math
from typing import Any

import numpy as np
from hypothesis import strategies as st
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

# Fields of packages that are not among those of `rosbags`, as in moveit_msgs 2.6, vision_msgs 4.1 and
# object_recognition_msgs 2.0.
OTHERS = {
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose"
    ),
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox3D bbox\nstring id"
    ),
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections",
    "object_recognition_msgs/msg/ObjectType": "string key\nstring db",
    "moveit_msgs/msg/CollisionObject": (
        "std_msgs/Header header\ngeometry_msgs/Pose pose\nstring id\nobject_recognition_msgs/ObjectType type\n"
        "shape_msgs/SolidPrimitive[] primitives\ngeometry_msgs/Pose[] primitive_poses\n"
        "shape_msgs/Mesh[] meshes\ngeometry_msgs/Pose[] mesh_poses\n"
        "shape_msgs/Plane[] planes\ngeometry_msgs/Pose[] plane_poses\n"
        "string[] subframe_names\ngeometry_msgs/Pose[] subframe_poses\n"
        "byte ADD=0\nbyte REMOVE=1\nbyte APPEND=2\nbyte MOVE=3\nbyte operation"
    ),
    "moveit_msgs/msg/GripperTranslation": (
        "geometry_msgs/Vector3Stamped direction\nfloat32 desired_distance\nfloat32 min_distance"
    ),
    "moveit_msgs/msg/Grasp": (
        "string id\ntrajectory_msgs/JointTrajectory pre_grasp_posture\n"
        "trajectory_msgs/JointTrajectory grasp_posture\ngeometry_msgs/PoseStamped grasp_pose\n"
        "float64 grasp_quality\nmoveit_msgs/GripperTranslation pre_grasp_approach\n"
        "moveit_msgs/GripperTranslation post_grasp_retreat\nmoveit_msgs/GripperTranslation post_place_retreat\n"
        "float32 max_contact_force\nstring[] allowed_touch_objects"
    ),
}

STORE = get_typestore(Stores.ROS2_JAZZY)
KNOWN = frozenset(STORE.fielddefs)
"""Names of the messages whose definition comes with `rosbags`."""
for name, text in OTHERS.items():
    STORE.register(get_types_from_msg(text, name))


def fields(name: str) -> list[tuple[str, Any]]:
    """Names and types of the fields of a message, in their order."""
    return STORE.fielddefs[name][1]


def values(name: str) -> st.SearchStrategy[dict[str, Any]]:
    """Random contents of a message: a dictionary of numbers, texts, lists and such dictionaries."""
    return st.fixed_dictionaries({field: _value(kind) for field, kind in fields(name)})


def _value(kind: Any) -> st.SearchStrategy[Any]:
    node, about = kind
    if node == Nodetype.BASE:
        return _number_or_text(about[0])
    if node == Nodetype.NAME:
        return values(about)
    element, count = about
    if node == Nodetype.ARRAY:
        return st.lists(_value(element), min_size=count, max_size=count)
    return st.lists(_value(element), max_size=count or 3)


def _number_or_text(name: str) -> st.SearchStrategy[Any]:
    if name == "bool":
        return st.booleans()
    if name == "string":
        return st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12)
    if name.startswith("float"):
        return st.floats(width=int(name[5:]), allow_nan=False)
    if name == "byte":  # which the other library takes for a signed one
        return st.integers(0, 127)
    limits = np.iinfo(name)
    return st.integers(int(limits.min), int(limits.max))


def theirs(name: str, content: dict[str, Any]) -> Any:
    """The message of `rosbags` with this content."""
    return STORE.types[name](**{field: _theirs(kind, content[field]) for field, kind in fields(name)})


def _theirs(kind: Any, value: Any) -> Any:
    node, about = kind
    if node == Nodetype.BASE:
        return value
    if node == Nodetype.NAME:
        return theirs(about, value)
    element = about[0]
    if element[0] == Nodetype.BASE and element[1][0] != "string":
        return np.array(value, dtype=element[1][0])
    return [_theirs(element, each) for each in value]


def same(a: Any, b: Any) -> bool:
    """Whether two contents are equal, however their lists are stored; 32-bit floats are rounded."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple | np.ndarray):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b or (isinstance(a, float) and math.isclose(a, b))

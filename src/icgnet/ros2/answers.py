"""Messages of ROS for a prediction: all in one frame, with one time stamp."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float

from icgnet.geometry.transforms import make_transform, matrix_to_quaternion, rotation_z, transform_points
from icgnet.grasping.converters import to_moveit
from icgnet.grasping.gripper import Gripper
from icgnet.inference.prediction import DetectedObject, Prediction
from icgnet.ros2.messages import (
    BoundingBox3D,
    CollisionObject,
    ColorRGBA,
    Detection3D,
    Detection3DArray,
    Duration,
    Grasp,
    GripperTranslation,
    Header,
    JointTrajectory,
    JointTrajectoryPoint,
    Marker,
    MarkerArray,
    Mesh,
    MeshTriangle,
    ObjectHypothesis,
    ObjectHypothesisWithPose,
    ObjectType,
    Point,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovariance,
    Quaternion,
    Vector3,
    Vector3Stamped,
)

ADD, REMOVE = 0, 1
"""Operations of a CollisionObject."""
LINE_LIST, TEXT, TRIANGLE_LIST = 5, 9, 11
"""Types of a Marker."""
DELETE_ALL = 3
"""Action of a Marker."""
LINE_WIDTH, LETTER_HEIGHT = 0.002, 0.02
HAND_LENGTH, FINGER_LENGTH = 0.1, 0.045
"""Of a drawn hand [m]."""
COLOURS = (
    (0.35, 0.55, 0.85),
    (0.95, 0.6, 0.3),
    (0.45, 0.75, 0.45),
    (0.8, 0.45, 0.65),
    (0.9, 0.8, 0.3),
    (0.5, 0.75, 0.8),
)


def object_name(instance_id: int) -> str:
    """Name of an object in detections and in the planning scene."""
    return f"icgnet_{instance_id}"


def pose_array(prediction: Prediction, header: Header) -> PoseArray:
    """The poses of the grasps, best first: z approach, y closing, origin midway between the finger tips."""
    return PoseArray(header, _poses(prediction.grasps.poses))


def detections(prediction: Prediction, header: Header) -> Detection3DArray:
    """The objects: class, probability, and the smallest box around the predicted shape that stands on the table."""
    return Detection3DArray(header, [_detection(item, prediction, header) for item in prediction.objects])


def collision_objects(prediction: Prediction, header: Header) -> list[CollisionObject]:
    """The predicted shapes as meshes, to be added to the planning scene or to replace what has their names there."""
    return [
        CollisionObject(
            header,
            id=object_name(item.instance_id),
            type=ObjectType(item.class_name),
            meshes=[_mesh(item.mesh())],
            mesh_poses=[Pose()],
            operation=ADD,
        )
        for item in prediction.objects
        if len(item.mesh().faces)
    ]


def removal(name: str, header: Header) -> CollisionObject:
    """Takes an object out of the planning scene."""
    return CollisionObject(header, id=name, operation=REMOVE)


def moveit_grasps(
    prediction: Prediction,
    gripper: Gripper,
    header: Header,
    hand_frame: str,
    joints: Sequence[str],
    T_base_parent: Float[np.ndarray, "4 4"],
) -> list[Grasp]:
    """The grasps for MoveIt, best first; arguments as of `icgnet.grasping.converters.to_moveit`."""
    up = prediction.T_frame_table[:3, 2]
    plain = to_moveit(prediction.grasps, gripper, header.frame_id, hand_frame, joints, T_base_parent, up=up)
    return [
        Grasp(
            id=each["id"],
            pre_grasp_posture=_posture(each["pre_grasp_posture"]),
            grasp_posture=_posture(each["grasp_posture"]),
            grasp_pose=PoseStamped(
                header,
                Pose(
                    Point(**each["grasp_pose"]["pose"]["position"]),
                    Quaternion(**each["grasp_pose"]["pose"]["orientation"]),
                ),
            ),
            grasp_quality=each["grasp_quality"],
            pre_grasp_approach=_translation(each["pre_grasp_approach"], header),
            post_grasp_retreat=_translation(each["post_grasp_retreat"], header),
            post_place_retreat=_translation(each["post_place_retreat"], header),
            max_contact_force=each["max_contact_force"],
            allowed_touch_objects=[object_name(int(instance_id))],
        )
        for each, instance_id in zip(plain, prediction.grasps.instances, strict=True)
    ]


def markers(prediction: Prediction, header: Header) -> MarkerArray:
    """A picture for RViz: shapes in the colour of their class, names, and hands from red (0) to green (1)."""
    found = [Marker(header, action=DELETE_ALL)]
    for item in prediction.objects:
        mesh, name = item.mesh(), f"{item.class_name} {item.score:.2f}"
        red, green, blue = COLOURS[prediction.classes.index(item.class_name) % len(COLOURS)]
        corners = mesh.vertices[mesh.faces].reshape(-1, 3)
        found.append(
            Marker(
                header,
                ns="objects",
                id=item.instance_id,
                type=TRIANGLE_LIST,
                scale=Vector3(1.0, 1.0, 1.0),
                color=ColorRGBA(red, green, blue, 0.8),
                points=_points(corners),
            )
        )
        above = _points(item.points.mean(axis=0, keepdims=True) + 0.06 * prediction.T_frame_table[:3, 2])
        found.append(
            Marker(
                header,
                ns="names",
                id=item.instance_id,
                type=TEXT,
                pose=Pose(above[0]),
                scale=Vector3(0.0, 0.0, LETTER_HEIGHT),
                color=ColorRGBA(1.0, 1.0, 1.0, 1.0),
                text=name,
            )
        )
    lines = np.concatenate([np.zeros((0, 3)), *_hands(prediction)])
    shades = [ColorRGBA(float(1 - score), float(score), 0.1, 1.0) for score in prediction.grasps.scores]
    each = len(lines) // len(shades) if shades else 0
    found.append(
        Marker(
            header,
            ns="grasps",
            type=LINE_LIST,
            scale=Vector3(LINE_WIDTH, 0.0, 0.0),
            color=ColorRGBA(0.0, 0.0, 0.0, 1.0),
            points=_points(lines),
            colors=[shade for shade in shades for _ in range(each)],
        )
    )
    return MarkerArray(found)


def _hands(prediction: Prediction) -> Iterator[Float[np.ndarray, "n 3"]]:
    """Ends of lines that draw each hand as a fork, as far open as on the way to the grasp [m]."""
    grasps = prediction.grasps
    for pose, opening in zip(grasps.poses, grasps.openings, strict=True):
        half, palm = opening / 2, -FINGER_LENGTH
        ends = [
            (0, -HAND_LENGTH),
            (0, palm),
            (-half, palm),
            (half, palm),
            (-half, palm),
            (-half, 0),
            (half, palm),
            (half, 0),
        ]
        yield transform_points(pose, np.array([(0.0, y, z) for y, z in ends]))


def _detection(item: DetectedObject, prediction: Prediction, header: Header) -> Detection3D:
    T_frame_box, size = _box(item, prediction.T_frame_table)
    (centre,) = _poses(T_frame_box[None])
    about = ObjectHypothesisWithPose(
        ObjectHypothesis(item.class_name, float(item.score * item.class_score)), PoseWithCovariance(centre)
    )
    return Detection3D(header, [about], BoundingBox3D(centre, Vector3(*size.tolist())), object_name(item.instance_id))


def _box(
    item: DetectedObject, T_frame_table: Float[np.ndarray, "4 4"]
) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "3"]]:
    """Pose and edges [m] of the smallest box around an object that is upright on the table."""
    vertices = item.mesh().vertices
    points = np.asarray(vertices if len(vertices) else item.points, dtype=np.float64)
    R = T_frame_table[:3, :3]
    yaw = _yaw_of_smallest_rectangle((points @ R)[:, :2])
    turned = R @ rotation_z(yaw)
    inside = points @ turned
    lower, upper = inside.min(axis=0), inside.max(axis=0)
    return make_transform(turned, turned @ ((lower + upper) / 2)), upper - lower


def _yaw_of_smallest_rectangle(points: Float[np.ndarray, "n 2"]) -> float:
    """Direction of an edge of the smallest rectangle around points in the plane [rad]; 0 for points on a line."""
    try:
        T_box_points, _ = trimesh.bounds.oriented_bounds_2D(points)
    except Exception:  # qhull raises what it likes for points on a line
        return 0.0
    return float(-np.arctan2(T_box_points[1, 0], T_box_points[0, 0]))


def _points(positions: Float[np.ndarray, "n 3"]) -> list[Point]:
    return [Point(x, y, z) for x, y, z in np.asarray(positions, dtype=np.float64).tolist()]


def _poses(poses: Float[np.ndarray, "n 4 4"]) -> list[Pose]:
    quaternions = matrix_to_quaternion(poses[:, :3, :3]).tolist() if len(poses) else []
    positions = _points(poses[:, :3, 3])
    return [Pose(at, Quaternion(x, y, z, w)) for at, (w, x, y, z) in zip(positions, quaternions, strict=True)]


def _mesh(mesh: trimesh.Trimesh) -> Mesh:
    return Mesh([MeshTriangle(corners) for corners in mesh.faces.tolist()], _points(mesh.vertices))


def _posture(plain: dict[str, Any]) -> JointTrajectory:
    points = [
        JointTrajectoryPoint(**each | {"time_from_start": Duration(**each["time_from_start"])})
        for each in plain["points"]
    ]
    return JointTrajectory(Header(), plain["joint_names"], points)


def _translation(plain: dict[str, Any], header: Header) -> GripperTranslation:
    direction = plain["direction"]
    stamped = Vector3Stamped(Header(header.stamp, direction["header"]["frame_id"]), Vector3(**direction["vector"]))
    return GripperTranslation(stamped, plain["desired_distance"], plain["min_distance"])

"""The messages of ROS 2 Jazzy that the node reads and writes: their fields in their order, and their names over DDS.

`sensor_msgs/msg/Image` is called `sensor_msgs::msg::dds_::Image_` there. Fields that are left out hold what a new
message of ROS holds. The tests compare the bytes of every message with those of another library and, where it can be
installed, of ROS itself.
"""

# Lengths of arrays stand where type checkers want types.
# pyright: reportGeneralTypeIssues=false

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from icgnet.ros2.dds import IdlStruct, array, float32, float64, int32, sequence, uint8, uint32


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    """`builtin_interfaces/msg/Time`."""

    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Duration(IdlStruct, typename="builtin_interfaces::msg::dds_::Duration_"):
    """`builtin_interfaces/msg/Duration`."""

    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Empty(IdlStruct, typename="std_msgs::msg::dds_::Empty_"):
    """`std_msgs/msg/Empty`; no message over DDS is without a field."""

    structure_needs_at_least_one_member: uint8 = 0


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    """`std_msgs/msg/Header`."""

    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class ColorRGBA(IdlStruct, typename="std_msgs::msg::dds_::ColorRGBA_"):
    """`std_msgs/msg/ColorRGBA`."""

    r: float32 = 0.0
    g: float32 = 0.0
    b: float32 = 0.0
    a: float32 = 0.0


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    """`geometry_msgs/msg/Point`."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Point32(IdlStruct, typename="geometry_msgs::msg::dds_::Point32_"):
    """`geometry_msgs/msg/Point32`."""

    x: float32 = 0.0
    y: float32 = 0.0
    z: float32 = 0.0


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    """`geometry_msgs/msg/Vector3`."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    """`geometry_msgs/msg/Quaternion`."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    """`geometry_msgs/msg/Pose`."""

    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    """`geometry_msgs/msg/PoseStamped`."""

    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)


@dataclass
class PoseArray(IdlStruct, typename="geometry_msgs::msg::dds_::PoseArray_"):
    """`geometry_msgs/msg/PoseArray`."""

    header: Header = field(default_factory=Header)
    poses: sequence[Pose] = field(default_factory=list)


@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovariance_"):
    """`geometry_msgs/msg/PoseWithCovariance`."""

    pose: Pose = field(default_factory=Pose)
    covariance: array[float64, 36] = field(default_factory=lambda: [0.0] * 36)


@dataclass
class Vector3Stamped(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3Stamped_"):
    """`geometry_msgs/msg/Vector3Stamped`."""

    header: Header = field(default_factory=Header)
    vector: Vector3 = field(default_factory=Vector3)


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    """`geometry_msgs/msg/Transform`."""

    translation: Vector3 = field(default_factory=Vector3)
    rotation: Quaternion = field(default_factory=Quaternion)


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    """`geometry_msgs/msg/TransformStamped`."""

    header: Header = field(default_factory=Header)
    child_frame_id: str = ""
    transform: Transform = field(default_factory=Transform)


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    """`tf2_msgs/msg/TFMessage`."""

    transforms: sequence[TransformStamped] = field(default_factory=list)


@dataclass
class Polygon(IdlStruct, typename="geometry_msgs::msg::dds_::Polygon_"):
    """`geometry_msgs/msg/Polygon`."""

    points: sequence[Point32] = field(default_factory=list)


@dataclass
class _ImageHead(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    """All of an image but its pixels."""

    header: Header = field(default_factory=Header)
    height: uint32 = 0
    width: uint32 = 0
    encoding: str = ""
    is_bigendian: uint8 = 0
    step: uint32 = 0


@dataclass
class Image(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    """`sensor_msgs/msg/Image`; one that came in has its pixels as an array of bytes."""

    header: Header = field(default_factory=Header)
    height: uint32 = 0
    width: uint32 = 0
    encoding: str = ""
    is_bigendian: uint8 = 0
    step: uint32 = 0
    data: sequence[uint8] = field(default_factory=list)

    @classmethod
    def deserialize(cls, data: bytes, has_header: bool = True, use_version_2: bool | None = None) -> "Image":
        """The image of these bytes; the pixels are the bytes themselves, where the library would list each one."""
        head = _ImageHead.deserialize(data, has_header, use_version_2)
        # What stands before the pixels is as long as it is when it is written again; a count of 4 bytes follows.
        start = -(-len(head.serialize()) // 4) * 4 + 4
        order = "<u4" if data[1] & 1 else ">u4"
        count = int(np.frombuffer(data, order, 1, start - 4)[0])
        image: Any = cls(**vars(head))
        image.data = np.frombuffer(data, np.uint8, count, start)
        return image


@dataclass
class RegionOfInterest(IdlStruct, typename="sensor_msgs::msg::dds_::RegionOfInterest_"):
    """`sensor_msgs/msg/RegionOfInterest`."""

    x_offset: uint32 = 0
    y_offset: uint32 = 0
    height: uint32 = 0
    width: uint32 = 0
    do_rectify: bool = False


@dataclass
class CameraInfo(IdlStruct, typename="sensor_msgs::msg::dds_::CameraInfo_"):
    """`sensor_msgs/msg/CameraInfo`."""

    header: Header = field(default_factory=Header)
    height: uint32 = 0
    width: uint32 = 0
    distortion_model: str = ""
    d: sequence[float64] = field(default_factory=list)
    k: array[float64, 9] = field(default_factory=lambda: [0.0] * 9)
    r: array[float64, 9] = field(default_factory=lambda: [0.0] * 9)
    p: array[float64, 12] = field(default_factory=lambda: [0.0] * 12)
    binning_x: uint32 = 0
    binning_y: uint32 = 0
    roi: RegionOfInterest = field(default_factory=RegionOfInterest)


@dataclass
class CompressedImage(IdlStruct, typename="sensor_msgs::msg::dds_::CompressedImage_"):
    """`sensor_msgs/msg/CompressedImage`."""

    header: Header = field(default_factory=Header)
    format: str = ""
    data: sequence[uint8] = field(default_factory=list)


@dataclass
class MeshTriangle(IdlStruct, typename="shape_msgs::msg::dds_::MeshTriangle_"):
    """`shape_msgs/msg/MeshTriangle`."""

    vertex_indices: array[uint32, 3] = field(default_factory=lambda: [0] * 3)


@dataclass
class Mesh(IdlStruct, typename="shape_msgs::msg::dds_::Mesh_"):
    """`shape_msgs/msg/Mesh`."""

    triangles: sequence[MeshTriangle] = field(default_factory=list)
    vertices: sequence[Point] = field(default_factory=list)


@dataclass
class Plane(IdlStruct, typename="shape_msgs::msg::dds_::Plane_"):
    """`shape_msgs/msg/Plane`."""

    coef: array[float64, 4] = field(default_factory=lambda: [0.0] * 4)


@dataclass
class SolidPrimitive(IdlStruct, typename="shape_msgs::msg::dds_::SolidPrimitive_"):
    """`shape_msgs/msg/SolidPrimitive`."""

    type: uint8 = 0
    dimensions: sequence[float64, 3] = field(default_factory=list)
    polygon: Polygon = field(default_factory=Polygon)


@dataclass
class UVCoordinate(IdlStruct, typename="visualization_msgs::msg::dds_::UVCoordinate_"):
    """`visualization_msgs/msg/UVCoordinate`."""

    u: float32 = 0.0
    v: float32 = 0.0


@dataclass
class MeshFile(IdlStruct, typename="visualization_msgs::msg::dds_::MeshFile_"):
    """`visualization_msgs/msg/MeshFile`."""

    filename: str = ""
    data: sequence[uint8] = field(default_factory=list)


@dataclass
class Marker(IdlStruct, typename="visualization_msgs::msg::dds_::Marker_"):
    """`visualization_msgs/msg/Marker`."""

    header: Header = field(default_factory=Header)
    ns: str = ""
    id: int32 = 0
    type: int32 = 0
    action: int32 = 0
    pose: Pose = field(default_factory=Pose)
    scale: Vector3 = field(default_factory=Vector3)
    color: ColorRGBA = field(default_factory=ColorRGBA)
    lifetime: Duration = field(default_factory=Duration)
    frame_locked: bool = False
    points: sequence[Point] = field(default_factory=list)
    colors: sequence[ColorRGBA] = field(default_factory=list)
    texture_resource: str = ""
    texture: CompressedImage = field(default_factory=CompressedImage)
    uv_coordinates: sequence[UVCoordinate] = field(default_factory=list)
    text: str = ""
    mesh_resource: str = ""
    mesh_file: MeshFile = field(default_factory=MeshFile)
    mesh_use_embedded_materials: bool = False


@dataclass
class MarkerArray(IdlStruct, typename="visualization_msgs::msg::dds_::MarkerArray_"):
    """`visualization_msgs/msg/MarkerArray`."""

    markers: sequence[Marker] = field(default_factory=list)


@dataclass
class ObjectHypothesis(IdlStruct, typename="vision_msgs::msg::dds_::ObjectHypothesis_"):
    """`vision_msgs/msg/ObjectHypothesis`."""

    class_id: str = ""
    score: float64 = 0.0


@dataclass
class ObjectHypothesisWithPose(IdlStruct, typename="vision_msgs::msg::dds_::ObjectHypothesisWithPose_"):
    """`vision_msgs/msg/ObjectHypothesisWithPose`."""

    hypothesis: ObjectHypothesis = field(default_factory=ObjectHypothesis)
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)


@dataclass
class BoundingBox3D(IdlStruct, typename="vision_msgs::msg::dds_::BoundingBox3D_"):
    """`vision_msgs/msg/BoundingBox3D`."""

    center: Pose = field(default_factory=Pose)
    size: Vector3 = field(default_factory=Vector3)


@dataclass
class Detection3D(IdlStruct, typename="vision_msgs::msg::dds_::Detection3D_"):
    """`vision_msgs/msg/Detection3D`."""

    header: Header = field(default_factory=Header)
    results: sequence[ObjectHypothesisWithPose] = field(default_factory=list)
    bbox: BoundingBox3D = field(default_factory=BoundingBox3D)
    id: str = ""


@dataclass
class Detection3DArray(IdlStruct, typename="vision_msgs::msg::dds_::Detection3DArray_"):
    """`vision_msgs/msg/Detection3DArray`."""

    header: Header = field(default_factory=Header)
    detections: sequence[Detection3D] = field(default_factory=list)


@dataclass
class ObjectType(IdlStruct, typename="object_recognition_msgs::msg::dds_::ObjectType_"):
    """`object_recognition_msgs/msg/ObjectType`."""

    key: str = ""
    db: str = ""


@dataclass
class CollisionObject(IdlStruct, typename="moveit_msgs::msg::dds_::CollisionObject_"):
    """`moveit_msgs/msg/CollisionObject`."""

    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)
    id: str = ""
    type: ObjectType = field(default_factory=ObjectType)
    primitives: sequence[SolidPrimitive] = field(default_factory=list)
    primitive_poses: sequence[Pose] = field(default_factory=list)
    meshes: sequence[Mesh] = field(default_factory=list)
    mesh_poses: sequence[Pose] = field(default_factory=list)
    planes: sequence[Plane] = field(default_factory=list)
    plane_poses: sequence[Pose] = field(default_factory=list)
    subframe_names: sequence[str] = field(default_factory=list)
    subframe_poses: sequence[Pose] = field(default_factory=list)
    operation: uint8 = 0


@dataclass
class JointTrajectoryPoint(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectoryPoint_"):
    """`trajectory_msgs/msg/JointTrajectoryPoint`."""

    positions: sequence[float64] = field(default_factory=list)
    velocities: sequence[float64] = field(default_factory=list)
    accelerations: sequence[float64] = field(default_factory=list)
    effort: sequence[float64] = field(default_factory=list)
    time_from_start: Duration = field(default_factory=Duration)


@dataclass
class JointTrajectory(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectory_"):
    """`trajectory_msgs/msg/JointTrajectory`."""

    header: Header = field(default_factory=Header)
    joint_names: sequence[str] = field(default_factory=list)
    points: sequence[JointTrajectoryPoint] = field(default_factory=list)


@dataclass
class GripperTranslation(IdlStruct, typename="moveit_msgs::msg::dds_::GripperTranslation_"):
    """`moveit_msgs/msg/GripperTranslation`."""

    direction: Vector3Stamped = field(default_factory=Vector3Stamped)
    desired_distance: float32 = 0.0
    min_distance: float32 = 0.0


@dataclass
class Grasp(IdlStruct, typename="moveit_msgs::msg::dds_::Grasp_"):
    """`moveit_msgs/msg/Grasp`."""

    id: str = ""
    pre_grasp_posture: JointTrajectory = field(default_factory=JointTrajectory)
    grasp_posture: JointTrajectory = field(default_factory=JointTrajectory)
    grasp_pose: PoseStamped = field(default_factory=PoseStamped)
    grasp_quality: float64 = 0.0
    pre_grasp_approach: GripperTranslation = field(default_factory=GripperTranslation)
    post_grasp_retreat: GripperTranslation = field(default_factory=GripperTranslation)
    post_place_retreat: GripperTranslation = field(default_factory=GripperTranslation)
    max_contact_force: float32 = 0.0
    allowed_touch_objects: sequence[str] = field(default_factory=list)


MESSAGES: dict[str, Any] = {
    kind.__idl_typename__.replace("::dds_::", "::").removesuffix("_").replace("::", "/"): kind
    for kind in list(vars().values())
    if isinstance(kind, type) and issubclass(kind, IdlStruct) and kind not in (IdlStruct, _ImageHead)
}
"""Messages by the name that ROS gives them, such as `sensor_msgs/msg/Image`."""

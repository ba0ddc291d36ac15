"""What the messages of ROS say is what the prediction says."""

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="needs icgnet[ros2]")

from http_service import known_prediction
from icgnet.geometry.transforms import make_transform, quaternion_to_matrix
from icgnet.grasping.converters import T_PANDA_HAND_LINK8, to_moveit
from icgnet.ros2.answers import collision_objects, detections, markers, moveit_grasps, pose_array, removal
from icgnet.ros2.messages import Header, Time

FOUND = known_prediction()
HEADER = Header(Time(12, 34), "optical")
JOINTS = ("left", "right")


def xyz(message) -> np.ndarray:
    return np.array([message.x, message.y, message.z])


def matrix(pose) -> np.ndarray:
    turn = pose.orientation
    return make_transform(quaternion_to_matrix(np.array([turn.w, turn.x, turn.y, turn.z])), xyz(pose.position))


def test_poses_are_those_of_the_grasps():
    message = pose_array(FOUND, HEADER)
    assert message.header == HEADER
    np.testing.assert_allclose([matrix(pose) for pose in message.poses], FOUND.grasps.poses, atol=1e-9)


def test_grasps_are_those_of_the_converter_with_the_header_of_the_image():
    found = moveit_grasps(FOUND, FOUND.gripper, HEADER, "hand", JOINTS, T_PANDA_HAND_LINK8)
    up = FOUND.T_frame_table[:3, 2]
    plain = to_moveit(FOUND.grasps, FOUND.gripper, "optical", "hand", JOINTS, up=up)
    assert len(found) == len(plain) > 5
    for grasp, expected, instance in zip(found, plain, FOUND.grasps.instances, strict=True):
        assert (grasp.id, grasp.grasp_quality) == (expected["id"], expected["grasp_quality"])
        assert grasp.grasp_pose.header == HEADER
        np.testing.assert_allclose(
            xyz(grasp.grasp_pose.pose.position), list(expected["grasp_pose"]["pose"]["position"].values())
        )
        np.testing.assert_allclose(xyz(grasp.post_grasp_retreat.direction.vector), up)
        assert grasp.post_grasp_retreat.direction.header == HEADER
        assert grasp.pre_grasp_approach.direction.header == Header(HEADER.stamp, "hand")
        assert grasp.pre_grasp_approach.min_distance < grasp.pre_grasp_approach.desired_distance
        assert grasp.pre_grasp_posture.joint_names == list(JOINTS)
        assert sum(grasp.grasp_posture.points[0].positions) < sum(grasp.pre_grasp_posture.points[0].positions)
        assert grasp.allowed_touch_objects == [f"icgnet_{instance}"]


def test_boxes_hold_the_shapes_and_stand_on_the_table():
    message = detections(FOUND, HEADER)
    assert message.header == HEADER
    for found, item in zip(message.detections, FOUND.objects, strict=True):
        pose, size = matrix(found.bbox.center), xyz(found.bbox.size)
        inside = np.abs((item.mesh().vertices - pose[:3, 3]) @ pose[:3, :3])
        assert (inside <= size / 2 + 1e-9).all()
        np.testing.assert_allclose(inside.max(axis=0), size / 2, atol=1e-9)
        np.testing.assert_allclose(pose[:3, 2], FOUND.T_frame_table[:3, 2], atol=1e-9)
        (about,) = found.results
        assert about.hypothesis.class_id == item.class_name
        assert about.hypothesis.score == pytest.approx(item.score * item.class_score)
        assert found.id == f"icgnet_{item.instance_id}"


def test_collision_objects_are_the_meshes():
    for found, item in zip(collision_objects(FOUND, HEADER), FOUND.objects, strict=True):
        (mesh,), (pose,) = found.meshes, found.mesh_poses
        np.testing.assert_array_equal([each.vertex_indices for each in mesh.triangles], item.mesh().faces)
        np.testing.assert_allclose([xyz(each) for each in mesh.vertices], item.mesh().vertices)
        np.testing.assert_array_equal(matrix(pose), np.eye(4))
        np.testing.assert_array_equal(matrix(found.pose), np.eye(4))
        assert (found.header, found.id, found.operation) == (HEADER, f"icgnet_{item.instance_id}", 0)
        assert found.type.key == item.class_name
    gone = removal("icgnet_7", HEADER)
    assert (gone.id, gone.operation, gone.meshes) == ("icgnet_7", 1, [])


def test_the_picture_has_each_shape_each_name_and_each_hand():
    found = markers(FOUND, HEADER).markers
    assert (found[0].action, {each.header.frame_id for each in found}) == (3, {"optical"})
    shapes = [each for each in found if each.ns == "objects"]
    assert [len(each.points) for each in shapes] == [3 * len(item.mesh().faces) for item in FOUND.objects]
    names = [each.text.split()[0] for each in found if each.ns == "names"]
    assert names == [item.class_name for item in FOUND.objects]
    (hands,) = (each for each in found if each.ns == "grasps")
    assert len(hands.points) == len(hands.colors) == 8 * len(FOUND.grasps)
    tips = np.array([xyz(each) for each in hands.points[5:8:2]])
    np.testing.assert_allclose(tips.mean(axis=0), FOUND.grasps.poses[0, :3, 3], atol=1e-9)
    assert np.linalg.norm(tips[0] - tips[1]) == pytest.approx(FOUND.grasps.openings[0])


def test_without_objects_nothing_is_left_over():
    empty = type(FOUND)(**vars(FOUND) | {"objects": (), "grasps": FOUND.grasps.empty()})
    assert pose_array(empty, HEADER).poses == []
    assert detections(empty, HEADER).detections == []
    assert collision_objects(empty, HEADER) == []
    assert [each.action for each in markers(empty, HEADER).markers] == [3, 0]
    assert moveit_grasps(empty, FOUND.gripper, HEADER, "hand", JOINTS, T_PANDA_HAND_LINK8) == []

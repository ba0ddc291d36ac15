"""The model of an arm, and the file that describes it."""

import sys
from dataclasses import replace
from importlib import reload

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

import needs_arm  # noqa: F401
from arm_scenes import link_meshes
from icgnet.arm import libraries
from icgnet.arm.arm import Arm
from icgnet.arm.description import ARMS, read_description
from icgnet.errors import DataError, InputError, MissingExtraError
from icgnet.geometry.transforms import make_transform
from icgnet.grasping.gripper import load_gripper

FR3 = yaml.safe_load((ARMS / "fr3.yaml").read_text()) | {"urdf": str(ARMS / "fr3.urdf")}

# Craig's convention: a, d, alpha of each joint and of the flange, from the maker's documentation.
DENAVIT_HARTENBERG = [
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -np.pi / 2),
    (0.0, 0.316, np.pi / 2),
    (0.0825, 0.0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0.0, 0.0, np.pi / 2),
    (0.088, 0.0, np.pi / 2),
    (0.0, 0.107, 0.0),
]

TWO_JOINTS = """<robot name="two">
  <link name="foot"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <joint name="turn" type="revolute"><parent link="foot"/><child link="arm"/><origin xyz="0 0 0.2"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <link name="arm"><collision><origin xyz="0.2 0 0"/><geometry><cylinder radius="0.03" length="0.4"/></geometry>
    </collision></link>
  <joint name="bend" type="revolute"><parent link="arm"/><child link="wrist"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <link name="wrist"><collision><geometry><sphere radius="0.04"/></geometry></collision></link>
  <joint name="slide" type="prismatic"><parent link="wrist"/><child link="finger"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.04" velocity="1" effort="1"/></joint>
  <link name="finger"><collision><geometry><box size="0.01 0.01 0.05"/></geometry></collision></link>
</robot>"""
TWO = {"name": "two", "urdf": "two.urdf", "home": [0, 0], "acceleration": [1, 1]} | {
    "mount": {"link": "wrist", "position": [0, 0, 0], "quaternion": [1, 0, 0, 0]}
}


def flange(joints: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    for (a, d, alpha), theta in zip(DENAVIT_HARTENBERG, [*joints, 0.0], strict=True):
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        pose = pose @ np.array(
            [[c, -s, 0, a], [s * ca, c * ca, -sa, -sa * d], [s * sa, c * sa, ca, ca * d], [0, 0, 0, 1]]
        )
    return pose


def test_the_flange_is_where_the_maker_says(fr3):
    for joints in np.random.default_rng(0).uniform(fr3.lower, fr3.upper, (20, 7)):
        np.testing.assert_allclose(fr3.mount_pose(joints), flange(joints), atol=1e-9)


def test_the_hand_hangs_on_the_flange_turned_by_45_degrees(fr3, hand):
    T_base_grasp = fr3.grasp_pose(fr3.home, hand)
    # 0.1123 m in front of panda_hand, closing along y of the base.
    np.testing.assert_allclose(T_base_grasp[:3, :3], np.diag([1.0, -1.0, -1.0]), atol=1e-9)
    np.testing.assert_allclose(T_base_grasp[:3, 3], flange(fr3.home)[:3, 3] - [0, 0, 0.1123], atol=1e-9)


def test_another_hand_has_its_own_place(fr3):
    gripper = load_gripper("robotiq_2f_85")
    T_mount_base = fr3.T_mount_grasp(gripper) @ gripper.T_grasp_base
    np.testing.assert_allclose(T_mount_base, fr3.description.T_link_mount, atol=1e-12)


def test_no_point_is_farther_from_a_joint_than_its_reach(fr3):
    for joints in np.random.default_rng(1).uniform(fr3.lower, fr3.upper, (20, 7)):
        points = np.concatenate([mesh.vertices for mesh in link_meshes(fr3, joints)[1:]])
        assert np.linalg.norm(points - fr3.shoulder, axis=1).max() <= fr3.reaches[0]


def test_the_hand_of_a_urdf_is_left_out_and_its_joints_are_no_joints(tmp_path):
    (tmp_path / "two.urdf").write_text(TWO_JOINTS)
    (tmp_path / "two.yaml").write_text(yaml.safe_dump(TWO))
    arm = Arm.load(tmp_path / "two.yaml")
    assert arm.joint_names == ("turn", "bend")
    assert [shape.link for shape in arm.link_shapes] == ["foot", "arm", "wrist"]
    assert arm.link_pairs == ((0, 2),)  # neighbours never meet
    np.testing.assert_allclose(arm.mount_pose(np.array([np.pi / 2, 0.0]))[:3, 3], [0, 0.4, 0.2], atol=1e-9)
    np.testing.assert_allclose(arm.velocity, [1.0, 1.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"home": None}, "home"),
        ({"speed": 1}, "speed unknown"),
        ({"urdf": "nothing.urdf"}, "urdf: no such file: nothing.urdf"),
        ({"mount": {"link": "hand", "position": [0, 0, 0], "quaternion": [1, 0, 0, 0]}}, "no link 'hand'"),
        ({"mount": {"link": "fr3_link8", "position": [0, 0, 107], "quaternion": [1, 0, 0, 0]}}, "in metres"),
        ({"mount": {"link": "fr3_link8", "position": [0, 0, 0], "quaternion": [1, 1, 0, 0]}}, "of length 1"),
        ({"velocity": [1, 1, 1, 1, 1, 1, 0]}, "velocity must be above 0"),
        ({"acceleration": None}, "acceleration"),
        ({"packages": "meshes"}, "packages must be a list of folders"),
        ({"lower": [0, 0]}, "lower must have shape (7,)"),
        ({"lower": [-166.0] * 7}, "lower of fr3_joint1 is -166, beyond the -2."),
        ({"velocity": [150.0] * 7}, "velocity of fr3_joint1 is 150, beyond the 2."),
        (
            {"home": [0] * 6, "lower": None, "upper": None, "velocity": None, "acceleration": [1] * 6},
            "home has 6 joints",
        ),
        ({"solver": "guess"}, "solver must be one of franka, numerical"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, change, message):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(FR3 | change))
    with pytest.raises(DataError, match=r"mine\.yaml|arm fr3") as error:
        Arm.load(path)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_up_is_away_from_the_ground_however_the_arm_stands(fr3):
    np.testing.assert_allclose(fr3.up, [0, 0, 1])
    turned = make_transform(Rotation.from_rotvec([0.0, np.pi / 2, 0.0]).as_matrix(), np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(Arm(replace(fr3.description, T_world_base=turned)).up, [-1, 0, 0], atol=1e-12)


SLIDING = """<robot name="gantry">
  <link name="foot"/>
  <joint name="turn" type="revolute"><parent link="foot"/><child link="post"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <link name="post"/>
  <joint name="out" type="prismatic"><parent link="post"/><child link="tool"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="1.5" velocity="1" effort="1"/></joint>
  <link name="tool"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
</robot>"""


def test_a_sliding_joint_takes_points_farther_out_and_moves_them_as_far_as_itself(tmp_path):
    (tmp_path / "two.urdf").write_text(SLIDING)
    mount = {"link": "tool", "position": [0, 0, 0], "quaternion": [1, 0, 0, 0]}
    (tmp_path / "two.yaml").write_text(yaml.safe_dump(TWO | {"mount": mount}))
    arm = Arm.load(tmp_path / "two.yaml")
    (far,) = link_meshes(arm, np.array([0.0, 1.5]))
    assert np.linalg.norm(far.vertices, axis=1).max() <= arm.reaches[0] < 1.65
    assert arm.reaches[1] == 1.0


def test_an_unknown_arm_is_told_the_known_ones():
    with pytest.raises(DataError, match=r"'ur7' is neither a file nor one of \['fr3'\]"):
        read_description("ur7")


def test_joints_outside_of_their_limits_are_named(fr3):
    with pytest.raises(InputError, match=r"start: fr3_joint4 must be between -2\.7478 and -0\.4461 rad, got 0"):
        fr3.check_joints(np.zeros(7) + [0, 0, 0, 0, 0, 1, 0], "start")


def test_a_missing_package_is_one_line_that_says_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "frankik", None)
    with pytest.raises(
        MissingExtraError, match=r'^planning for an arm needs .*frankik.*: pip install "icgnet\[arm\]"$'
    ):
        reload(libraries)
    monkeypatch.undo()
    reload(libraries)


def test_joints_and_what_they_move_make_the_chain(fr3):
    joints = fr3.home + 0.2
    pose = np.eye(4)
    for frame, motion, angle in zip(fr3.joint_frames, fr3.joint_motions, joints, strict=True):
        assert np.abs(motion[:3]).max() == 0.0
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec(angle * motion[3:]).as_matrix()
        pose = pose @ frame @ turn
    np.testing.assert_allclose(pose @ fr3.T_joint_mount, fr3.mount_pose(joints), atol=1e-9)
    assert fr3.efforts.tolist() == [87.0] * 4 + [12.0] * 3

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from icgnet.geometry.transforms import invert_transform, transform_points, transform_vectors, yaw_about
from icgnet.grasping.frame import APPROACH_ANGLES, SINGULAR_COSINE, contact_frames, grasp_poses, grasp_rotations

CONTACT = np.array([[0.12, 0.17, 0.1]])
azimuths = st.floats(0, 2 * np.pi)
widths = st.floats(0.0, 0.08)


def direction(polar: float, azimuth: float) -> np.ndarray:
    return np.array([[np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]])


# All polar angles, with the poles themselves and both sides of the border where the definition changes.
border = float(np.arccos(SINGULAR_COSINE))
polars = st.one_of(
    st.floats(0, np.pi),
    st.sampled_from(
        [0.0, np.pi, np.pi / 2, border - 1e-9, border + 1e-9, np.pi - border - 1e-9, np.pi - border + 1e-9]
    ),
)


def test_twelve_approach_angles_span_half_a_turn():
    assert len(APPROACH_ANGLES) == 12
    assert np.allclose(np.rad2deg(APPROACH_ANGLES[[0, 1, 11]]), [-90, -90 + 180 / 11, 90])
    assert np.allclose(APPROACH_ANGLES, -APPROACH_ANGLES[::-1])


@given(polars, azimuths)
def test_rotations_are_proper_for_every_normal(polar, azimuth):
    R = grasp_rotations(direction(polar, azimuth))[0]
    assert np.isfinite(R).all()
    assert np.abs(np.linalg.det(R) - 1).max() < 1e-9
    assert np.allclose(R.transpose(0, 2, 1) @ R, np.eye(3), atol=1e-9)


@given(polars, azimuths)
def test_rotations_of_single_precision_normals_are_proper(polar, azimuth):
    R = grasp_rotations(direction(polar, azimuth).astype(np.float32))[0]
    assert np.abs(np.linalg.det(R) - 1).max() < 1e-9


@given(polars, azimuths)
def test_closing_axis_is_the_normal_at_every_angle(polar, azimuth):
    normal = direction(polar, azimuth)
    assert np.allclose(grasp_rotations(normal)[0, :, :, 1], normal, atol=1e-12)


@given(azimuths)
def test_angle_zero_approaches_a_vertical_wall_from_above(azimuth):
    assert np.allclose(contact_frames(direction(np.pi / 2, azimuth))[0, :, 2], [0, 0, -1], atol=1e-12)
    # Twelve angles leave zero out: the two in the middle lean as much to one side as to the other.
    approach = grasp_rotations(direction(np.pi / 2, azimuth))[0, 5:7, :, 2]
    assert np.allclose(approach.sum(axis=0), [0, 0, -2 * np.cos(np.pi / 22)], atol=1e-9)


@given(azimuths)
def test_last_and_first_angle_approach_a_vertical_wall_from_its_sides(azimuth):
    approach = grasp_rotations(direction(np.pi / 2, azimuth))[0, [0, 11], :, 2]
    assert np.allclose(approach[:, 2], 0, atol=1e-12)
    assert np.allclose(approach[0], -approach[1], atol=1e-12)


@given(st.floats(0, 0.199), azimuths, st.floats(-1e-6, 1e-6), st.booleans())
def test_frames_of_near_vertical_normals_are_continuous(polar, azimuth, step, downwards):
    sign = -1.0 if downwards else 1.0
    frame = contact_frames(sign * direction(polar, azimuth))
    beside = contact_frames(sign * direction(abs(polar + step), azimuth + step))
    assert np.abs(frame - beside).max() < 1e-5


def test_vertical_normal_has_world_x_as_its_x_axis():
    assert np.allclose(contact_frames(np.array([[0.0, 0.0, 1.0]]))[0], [[1, 0, 0], [0, 0, -1], [0, 1, 0]])


@given(polars, azimuths, st.floats(-7, 7), widths)
def test_grasps_turn_with_the_scene(polar, azimuth, yaw, width):
    # The definition at vertical normals refers to world x, so it cannot turn along.
    assume(abs(np.cos(polar)) < SINGULAR_COSINE - 1e-6)
    T = yaw_about(np.array([0.15, 0.15, 0.0]), yaw)
    normal, w = direction(polar, azimuth), np.array([width])
    turned = grasp_poses(transform_points(T, CONTACT), transform_vectors(T, normal), w)
    assert np.allclose(turned, T @ grasp_poses(CONTACT, normal, w), atol=1e-9)


@given(polars, azimuths, widths, st.floats(0.0, 0.03))
def test_hand_is_centred_on_the_object(polar, azimuth, width, reach):
    normal = direction(polar, azimuth)
    opposite = CONTACT - width * normal
    for pose in grasp_poses(CONTACT, normal, np.array([width]), reach)[0]:
        in_hand = transform_points(invert_transform(pose), np.concatenate([CONTACT, opposite]))
        assert np.allclose(in_hand, [[0, width / 2, -reach], [0, -width / 2, -reach]], atol=1e-9)


@given(polars, azimuths, widths)
def test_both_contacts_of_an_object_give_the_same_hands(polar, azimuth, width):
    assume(abs(np.cos(polar)) < SINGULAR_COSINE - 1e-6)
    normal, w = direction(polar, azimuth), np.array([width])
    one_side = grasp_poses(CONTACT, normal, w)[0]
    other_side = grasp_poses(CONTACT - width * normal, -normal, w)[0]
    half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    assert np.allclose(other_side[::-1], one_side @ half_turn, atol=1e-9)


def test_hand_worked_grasp_from_above():
    pose = grasp_poses(np.array([[0.1, 0.2, 0.3]]), np.array([[1.0, 0.0, 0.0]]), np.array([0.04]), 0.01)[0, 5]
    angle = -np.pi / 22
    approach = np.array([0, np.sin(angle), -np.cos(angle)])
    assert np.allclose(pose[:3, 2], approach)
    assert np.allclose(pose[:3, 3], np.array([0.08, 0.2, 0.3]) + 0.01 * approach)

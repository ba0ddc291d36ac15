import numpy as np
import torch

from icgnet.grasping.frame import APPROACH_ANGLES, grasp_rotations
from icgnet.network.config import FRANKA, HandConfig
from icgnet.network.hand_decoder import hand_frames, table_clearance
from icgnet.network.hand_input import HandInput


def random_normals(count: int = 20) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    normals = torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=1)
    return torch.cat([normals, torch.tensor([[0.0, 0, 1], [0, 0, -1], [0.1, 0, 0.995]])])


def test_hand_frames_are_the_grasp_frames():
    normals = torch.nn.functional.normalize(random_normals().double(), dim=1)
    frames = hand_frames(normals, len(APPROACH_ANGLES))
    np.testing.assert_allclose(frames.numpy(), grasp_rotations(normals.numpy()), atol=1e-9)


def test_control_points_turn_with_the_scene():
    normals = random_normals()[:20]
    angle = torch.tensor(0.7)
    yaw = torch.tensor([[angle.cos(), -angle.sin(), 0], [angle.sin(), angle.cos(), 0], [0, 0, 1.0]])
    own = HandInput.of(FRANKA, HandConfig()).points.t()
    points = hand_frames(normals, 12) @ own
    turned = hand_frames(normals @ yaw.t(), 12) @ own
    torch.testing.assert_close(turned, yaw @ points, atol=1e-6, rtol=0)


def test_approach_is_from_above_in_the_middle_of_the_angles_at_a_wall():
    frames = hand_frames(torch.tensor([[1.0, 0, 0]]), 3)
    torch.testing.assert_close(frames[0, 1, :, 2], torch.tensor([0.0, 0, -1]))


def test_clearance_is_measured_from_the_table_in_units_of_two_centimetres():
    points = torch.tensor([[[0.1, 0.1, 0.07], [0.0, 0.0, 0.2]], [[0, 0, 0.0], [0, 0, 0.3]]])
    torch.testing.assert_close(table_clearance(points), torch.tensor([1.0, -2.0]))

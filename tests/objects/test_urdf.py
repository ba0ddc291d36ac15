from pathlib import Path

import numpy as np
import pytest

from icgnet.errors import DataError
from icgnet.objects.urdf import read_convex_groups, read_urdf_object

BOTH = "<visual><geometry>{0}</geometry></visual><collision><geometry>{0}</geometry></collision>"
NAME = "x" * 5000


def linked(shape: str) -> str:
    return f"<robot><link>{BOTH.format(shape)}</link></robot>"


def test_each_group_becomes_one_convex_piece(tmp_path: Path, write_object):
    model = read_urdf_object(write_object(tmp_path, "cube"), "cube", "box")
    assert len(model.parts) == 2
    assert [part.volume for part in model.parts] == pytest.approx([0.05**3 / 2] * 2)
    assert model.visual.volume == pytest.approx(0.05**3)


def test_split_vertices_and_inverted_faces_are_mended(tmp_path: Path, write_object):
    path = write_object(tmp_path, "cube")
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * 0.05
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines = [f"v {x} {y} {z}" for quad in quads for x, y, z in corners[list(quad)]]
    lines += [f"f {4 * i + 4} {4 * i + 3} {4 * i + 2} {4 * i + 1}" for i in range(6)]
    (tmp_path / "cube_visual.obj").write_text("\n".join(lines))
    visual = read_urdf_object(path, "cube", "box").visual
    assert len(visual.vertices) == 8
    assert visual.is_watertight
    assert visual.volume == pytest.approx(0.05**3)


def test_scale_origin_and_primitives_are_applied(tmp_path: Path, write_object):
    path = write_object(tmp_path, "cube")
    path.write_text(
        """<robot name="cube"><link name="l">
        <visual><origin xyz="0 0 0.1" rpy="0 0 0"/>
          <geometry><mesh filename="cube_visual.obj" scale="1 2 1"/></geometry></visual>
        <collision><origin rpy="1.5707963267948966 0 0"/><geometry><cylinder radius="0.01" length="0.08"/></geometry>
        </collision></link></robot>"""
    )
    model = read_urdf_object(path, "cube", "box")
    np.testing.assert_allclose(model.visual.bounds, [[-0.025, -0.05, 0.075], [0.025, 0.05, 0.125]], atol=1e-9)
    np.testing.assert_allclose(model.parts[0].extents, [0.02, 0.08, 0.02], atol=1e-3)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("<robot><link>", "broken URDF"),
        ("<robot/>", "found 0 links"),
        ("<robot><link/><link/></robot>", "found 2 links"),
        ("<robot><link/></robot>", "no <visual>"),
        ("<robot><link><visual/></link></robot>", "<visual> without geometry"),
        ("<robot><link><visual><geometry><mesh/></geometry></visual></link></robot>", "without a filename"),
        ("<robot><link><visual><geometry><mesh filename='no.obj'/></geometry></visual></link></robot>", "missing mesh"),
        ("<robot><link><visual><geometry><box size='1 2'/></geometry></visual></link></robot>", "not three numbers"),
        ("<robot><link><visual><geometry><sphere/></geometry></visual></link></robot>", "not a number"),
        (linked('<box size="-1 1 1"/>'), "must be positive"),
        (linked('<sphere radius="nan"/>'), "must be positive"),
        (linked('<box size="50 60 100"/>'), "100 m: are the units right"),
        (linked('<mesh filename="../cube.obj"/>'), "in the folder"),
        (linked('<mesh filename="a/../../cube.obj"/>'), "in the folder"),
        (linked('<mesh filename="file:///cube.obj"/>'), "in the folder"),
        (linked(f'<mesh filename="{NAME}.obj"/>'), "name too long"),
        ("<robot><link><visual><geometry><capsule/></geometry></visual></link></robot>", "unknown geometry <capsule>"),
        ("<robot><link><visual><geometry><box size='1 1 1'/></geometry></visual></link></robot>", "no <collision>"),
    ],
)
def test_broken_urdf_is_named_with_what_is_wrong(tmp_path: Path, content: str, message: str):
    path = tmp_path / "thing.urdf"
    path.write_text(content)
    with pytest.raises(DataError, match=message) as error:
        read_urdf_object(path, "thing", "other")
    assert str(tmp_path) in str(error.value)


@pytest.mark.parametrize(
    "content", ["", "v 0 0 0\nf 1 2 9\n", "v 0 0 x\n", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 3 4\n"]
)
def test_broken_collision_mesh_is_named(tmp_path: Path, content: str):
    path = tmp_path / "broken_collision.obj"
    path.write_text(content)
    with pytest.raises(DataError, match=r"broken_collision\.obj"):
        read_convex_groups(path)


def test_indices_may_be_relative_and_carry_texture_coordinates(tmp_path: Path):
    path = tmp_path / "tetra.obj"
    path.write_text("g a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf -4//1 -3//1 -2//1\nf 1/1 2/1 4/1\n")
    assert read_convex_groups(path)[0].volume == pytest.approx(1.0 / 6.0)

"""A tiny object set in the VGN layout, written by hand."""

from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh

URDF = """<?xml version="1.0"?>
<robot name="{name}">
  <link name="base_link">
    <inertial><mass value="0.1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
    <visual><geometry><mesh filename="{name}_visual.obj"/></geometry></visual>
    <collision><geometry><mesh filename="{name}_collision.obj"/></geometry></collision>
  </link>
</robot>
"""


def write_urdf_object(folder: Path, name: str, size: float = 0.05) -> Path:
    """Writes a cube whose collision mesh has two halves as convex groups; returns the URDF's path."""
    folder.mkdir(parents=True, exist_ok=True)
    trimesh.creation.box([size] * 3).export(folder / f"{name}_visual.obj")
    lines, start = [], 1
    for group, centre in enumerate((-0.25 * size, 0.25 * size)):
        half = trimesh.creation.box([0.5 * size, size, size]).apply_translation([centre, 0.0, 0.0])
        lines.append(f"o convex_{group}")
        lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in half.vertices]
        lines += ["f " + " ".join(str(index + start) for index in face) for face in half.faces]
        start += len(half.vertices)
    (folder / f"{name}_collision.obj").write_text("\n".join(lines) + "\n")
    path = folder / f"{name}.urdf"
    path.write_text(URDF.format(name=name))
    return path


@pytest.fixture
def write_object() -> Callable[..., Path]:
    return write_urdf_object


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ICGNET_CACHE", str(tmp_path_factory.mktemp("cache")))


@pytest.fixture
def urdf_folder(tmp_path: Path) -> Path:
    """Four names in the VGN layout: two to train, one of them listed in val.txt, and two to test."""
    for kind in ("packed", "pile"):
        for split, names in {"train": ("cup", "brick"), "test": ("tin",)}.items():
            for name in names:
                write_urdf_object(tmp_path / "things" / kind / split, name)
    (tmp_path / "things" / "classes.json").write_text('{"objects": {"cup": "mug", "tin": "can"}}')
    (tmp_path / "things" / "val.txt").write_text("brick\n")
    return tmp_path / "things"

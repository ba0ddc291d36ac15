"""`icgnet sensors`: one scene as seen by many sensors, on a contact sheet."""

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from icgnet.cli.notices import load_objects
from icgnet.errors import InputError
from icgnet.objects.kinds import Kind, Split


@dataclass(frozen=True)
class Sensors:
    """Draw what each sensor model does to the cloud of a simulated scene: every error alone, presets, and cameras."""

    out: Path
    """File to write, ending in .png."""
    objects: str = "procedural"
    """'procedural', or a folder of URDFs (VGN layout) or meshes."""
    split: Split = "test"
    """Which objects."""
    scene: Kind = "packed"
    """Objects standing side by side, or dropped into a pile."""
    count: int = 5
    """Objects to try to place."""
    polar: float = 45.0
    """Angle of the camera from the vertical [degrees]."""
    seed: int = 0
    """Of every random draw."""
    panel: tuple[int, int] = (300, 360)
    """Height and width of the picture of one cloud [pixels]."""

    def run(self) -> None:
        """Draws the sheet.

        Raises:
            IcgnetError: unknown objects, a file name of another kind, or an empty table.
        """
        if self.out.suffix != ".png":
            raise InputError(f"the file to write must end in .png, got {self.out.name!r}")
        if self.count < 1:
            raise InputError(f"count must be at least 1, got {self.count}")
        from icgnet.viewer.sheet import check_panel

        check_panel(self.panel)
        import numpy as np

        from icgnet.simulation.scenes import spawn_scene
        from icgnet.training.gallery import make_gallery
        from icgnet.viewer.sensor_sheet import SeenCloud, draw_sensor_sheet

        object_set = load_objects(self.objects)
        scene = spawn_scene(self.scene, object_set, self.split, np.random.default_rng(self.seed), self.count)
        gallery = make_gallery(scene, object_set, np.deg2rad(self.polar), self.seed)
        clouds = [
            SeenCloud(each.caption, each.cloud.points, each.cloud.owners, each.cloud.viewpoint, each.spacing)
            for each in gallery
        ]
        draw_sensor_sheet(clouds, self.out, self.panel)
        Console().print(f"{self.out}: {len(scene.objects)} objects as seen by many sensors", soft_wrap=True)

"""`icgnet simulate`: a depth capture of a random scene, for trying things out."""

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from icgnet.cli.notices import load_objects
from icgnet.errors import InputError
from icgnet.objects.kinds import Kind, Split


@dataclass(frozen=True)
class Simulate:
    """Take a noisy depth image of a simulated scene, as an npz file that `icgnet predict` reads."""

    out: Path
    """File to write, ending in .npz."""
    objects: str = "procedural"
    """'procedural', or a folder of URDFs (VGN layout) or meshes."""
    split: Split = "test"
    """Which objects."""
    scene: Kind = "packed"
    """Objects standing side by side, or dropped into a pile; or a whole table or bin."""
    count: int = 5
    """Objects to try to place."""
    seed: int = 0
    """Of every random draw."""

    def run(self) -> None:
        """Simulates, and says what is in the image.

        Raises:
            IcgnetError: unknown objects, or a file name of another kind.
        """
        if self.out.suffix != ".npz":
            raise InputError(f"the file to write must end in .npz, got {self.out.name!r}")
        if self.count < 1:
            raise InputError(f"count must be at least 1, got {self.count}")
        import numpy as np

        from icgnet.sensors.capture import simulate_capture

        object_set = load_objects(self.objects)
        capture = simulate_capture(self.scene, object_set, self.split, np.random.default_rng(self.seed), self.count)
        capture.save(self.out)
        Console().print(f"{self.out}: {', '.join(capture.classes) or 'nothing'} on the table", soft_wrap=True)

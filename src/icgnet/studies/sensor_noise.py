"""Do simulated depth images err as real ones do? The same measures of both, for each camera of which there are frames.

Each simulated image is of a random table or bin with all that stands around, by the same camera at the distance and
tilt of a real frame.
"""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from icgnet.benchmark.labelled_frames import find_frames, read_frame
from icgnet.benchmark.statistics import Quantiles
from icgnet.benchmark.tables import NOTHING, Table
from icgnet.errors import DataError
from icgnet.geometry.camera import sphere_pose
from icgnet.geometry.workspace import CENTRE, TABLE_HEIGHT
from icgnet.objects.kinds import WIDE_KINDS, Kind
from icgnet.objects.object_set import ObjectSet, load_object_set
from icgnet.sensors.config import CAMERAS, CameraModel
from icgnet.sensors.noise import corrupt_depth
from icgnet.simulation.camera import DepthImage, SceneRenderer
from icgnet.simulation.scene import Scene, scene_triangles
from icgnet.simulation.scenes import spawn_scene
from icgnet.studies.config import SensorNoiseConfig
from icgnet.studies.depth_measures import FrameMeasures, FrameSamples, measure_frame
from icgnet.viewer.noise_histograms import HistogramRow, draw_histograms

TARGET = np.array([CENTRE[0], CENTRE[1], TABLE_HEIGHT])
"""What simulated cameras look at, world frame [m]."""
BIN_CAMERAS = ("phoxi",)
"""Cameras that are made for bins; the others look at tables."""
NEAREST, PLACES = 0.2, 20
"""Where something would be nearer than this to a camera [m], it stands elsewhere, for so many places."""
USUAL_TILT = 45.0
"""Of a camera in whose frames nothing flat is seen [degrees]."""

ROWS = {
    "distance": ("median depth [m]", 2),
    "tilt": ("tilt of flat parts [degrees]", 0),
    "noise": ("noise in 15 pixels [mm/m²]", 2),
    "ripple": ("noise in 45 pixels [mm/m²]", 2),
    "alike_1": ("correlation 1 pixel apart in a row", 2),
    "alike_4": ("correlation 4 pixels apart in a row", 2),
    "alike_down": ("correlation 4 pixels apart in a column", 2),
    "step": ("steps of the depth [mm]", 2),
    "holes": ("without depth [%]", 2),
    "holes_inside": ("without depth inside of surfaces [%]", 2),
    "holes_shadow": ("without depth at edges, side of the shadow [pixels]", 1),
    "holes_lit": ("without depth at edges, other side [pixels]", 1),
    "shadow_baseline": ("baseline by the shadows [mm]", 0),
    "flying": ("between the surfaces at an edge [pixels]", 2),
    "ragged": ("raggedness of edges [pixels]", 2),
}
"""Label and digits of each measure."""
FACTORS = {"holes": 100.0, "holes_inside": 100.0, "shadow_baseline": 1000.0}
PANELS = {
    "noise": "noise of flat parts [mm/m²]",
    "alike": "correlation 4 pixels apart in a row",
    "holes": "without depth at an edge [pixels]",
    "flying": "between surfaces [pixels]",
}
"""Title of each histogram."""


@dataclass(frozen=True, eq=False)
class CameraNumbers:
    """What was measured of one camera.

    Attributes:
        name: as in `CAMERAS`.
        frames: names of the real frames.
        real: of each of them.
        ours: of each simulated image.
        samples: values of all real frames, and of all simulated images.
    """

    name: str
    frames: tuple[str, ...]
    real: tuple[FrameMeasures, ...]
    ours: tuple[FrameMeasures, ...]
    samples: tuple[tuple[FrameSamples, ...], tuple[FrameSamples, ...]]


@dataclass(frozen=True, eq=False)
class SensorNumbers:
    """Of every camera of which there are frames; frames without a camera that we know were left out."""

    cameras: tuple[CameraNumbers, ...]
    left_out: tuple[str, ...]

    def report(self) -> dict[str, Any]:
        """Measures of every image by camera, without the single values."""
        return {
            "left_out": self.left_out,
            "cameras": {
                each.name: {
                    "real": dict(zip(each.frames, map(asdict, each.real), strict=True)),
                    "simulated": [asdict(measures) for measures in each.ours],
                }
                for each in self.cameras
            },
        }


def measure(config: SensorNoiseConfig) -> SensorNumbers:
    """Measures the real frames, and simulated images of the same cameras.

    Raises:
        IcgnetError: unusable frames or objects, or no frame that names one of our cameras.
    """
    object_set = load_object_set(config.objects)
    found: dict[str, list[tuple[str, FrameMeasures, FrameSamples]]] = {}
    left_out = []
    for frame in map(read_frame, find_frames(config.captures)):
        if frame.camera not in CAMERAS:
            left_out.append(frame.name)
            continue
        measures = measure_frame(np.nan_to_num(frame.depth), frame.intrinsics, CAMERAS[frame.camera].focal)
        found.setdefault(frame.camera, []).append((frame.name, *measures))
    if not found:
        raise DataError(
            f"{config.captures}: no frame names its camera; give in camera.json or NAME.json as 'camera' one of "
            f"{', '.join(CAMERAS)}"
        )
    names = [name for name in CAMERAS if name in found]
    # All cameras look at the same scenes, which take longer than their pictures.
    kinds = {_kind(name) for name in names}
    scenes = {kind: _draw_scenes(kind, object_set, config) for kind in WIDE_KINDS if kind in kinds}
    numbers = []
    for name in names:
        frames, real, samples = zip(*found[name], strict=True)
        ours, our_samples = zip(
            *simulate(CAMERAS[name], real, scenes[_kind(name)], object_set, config.seed), strict=True
        )
        numbers.append(CameraNumbers(name, frames, real, ours, (samples, our_samples)))
    return SensorNumbers(tuple(numbers), tuple(left_out))


def simulate(
    camera: CameraModel, real: Sequence[FrameMeasures], scenes: Sequence[Scene], object_set: ObjectSet, seed: int
) -> list[tuple[FrameMeasures, FrameSamples]]:
    """Measures of an image of each scene by a camera from where the real frames were taken, in turn."""
    rng = np.random.default_rng(seed)
    result = []
    for number, scene in enumerate(scenes):
        frame = real[number % len(real)]
        image = _look(camera, frame, scene, object_set, rng)
        depth = corrupt_depth(image, camera.intrinsics, camera.noise, rng).depth.astype(np.float64)
        # As whoever took the frames made them smaller, if they did.
        intrinsics = camera.intrinsics
        intrinsics[:2] /= frame.smaller
        result.append(measure_frame(depth[:: frame.smaller, :: frame.smaller], intrinsics, camera.focal))
    return result


def _kind(camera: str) -> Kind:
    return "bin" if camera in BIN_CAMERAS else "table"


def _draw_scenes(kind: Kind, object_set: ObjectSet, config: SensorNoiseConfig) -> list[Scene]:
    rng = np.random.default_rng(config.seed)
    return [spawn_scene(kind, object_set, config.split, rng) for _ in range(config.images)]


def _look(
    camera: CameraModel, frame: FrameMeasures, scene: Scene, object_set: ObjectSet, rng: np.random.Generator
) -> DepthImage:
    """A picture of a scene without errors, from the distance and tilt of a real frame."""
    tilt = np.deg2rad(USUAL_TILT if frame.tilt is None else frame.tilt)
    renderer = SceneRenderer(*scene_triangles(scene, object_set), extent=scene.surroundings.extent)
    places = [sphere_pose(TARGET, frame.distance, float(tilt), yaw) for yaw in rng.uniform(0, 2 * np.pi, PLACES)]
    for pose in places[:-1]:
        image = renderer.render(camera.intrinsics, camera.shape, pose)
        if not ((image.depth > 0) & (image.depth < NEAREST)).any():
            return image
    return renderer.render(camera.intrinsics, camera.shape, places[-1])


def tables(numbers: SensorNumbers) -> list[Table]:
    """A table for each camera: median of the images, and 10 to 90 %."""
    notes = (f"left out, since they name none of our cameras: {len(numbers.left_out)} frames",)
    return [
        Table(
            (each.name, f"{len(each.real)} real", f"{len(each.ours)} simulated"),
            [
                (label, *(_cell(side, name, digits) for side in (each.real, each.ours)))
                for name, (label, digits) in ROWS.items()
            ],
            notes=notes if numbers.left_out and each is numbers.cameras[-1] else (),
        )
        for each in numbers.cameras
    ]


def draw(numbers: SensorNumbers, path: Path) -> None:
    """Writes a PNG with pairs of histograms."""
    rows = [
        HistogramRow(
            each.name, *({title: _joined(side, name) for name, title in PANELS.items()} for side in each.samples)
        )
        for each in numbers.cameras
    ]
    draw_histograms(rows, path)


def _cell(measures: Iterable[FrameMeasures], name: str, digits: int) -> str:
    values = [getattr(each, name) for each in measures]
    present = [value * FACTORS.get(name, 1.0) for value in values if value is not None]
    if not present:
        return NOTHING
    found = Quantiles.of(present)
    return f"{found:.{digits}f}" if len(present) > 2 else f"{found.median:.{digits}f}"


def _joined(samples: Iterable[FrameSamples], name: str) -> np.ndarray:
    return np.concatenate([getattr(each, name) for each in samples])

"""`icgnet benchmark reconstruction`, `segmentation` and `latency`: the network's own numbers."""

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.console import Console
from rich.progress import Progress, track
from rich.table import Table

from icgnet.benchmark.record import write_report
from icgnet.cli.notices import load_objects
from icgnet.errors import InputError

if TYPE_CHECKING:
    from icgnet.benchmark.latency import LatencyNumbers, ModelSize
    from icgnet.benchmark.pictures import Picture, PictureConfig
    from icgnet.benchmark.reconstruction import ReconstructionNumbers
    from icgnet.benchmark.segmentation import SegmentationNumbers
    from icgnet.benchmark.statistics import Spread
    from icgnet.predictor import Predictor


@dataclass(frozen=True)
class _OnPictures:
    """What the three commands share: they predict the first picture of each scene of the clutter benchmark."""

    objects: str = "procedural"
    """Object set: 'procedural' or a folder."""
    scene: Literal["packed", "pile"] = "packed"
    """Kind of scenes."""
    split: Literal["train", "val", "test"] = "test"
    """Which objects: val for choosing, test for reporting."""
    view: Literal["random", "side", "top"] = "random"
    """Where the camera stands."""
    noise: Literal["none", "gaussian", "dex"] = "gaussian"
    """What the sensor does."""
    scenes: int = 20
    """How many scenes, with one picture each."""
    seed: int = 1
    """Of every random draw; scenes are those of run 0 of the clutter benchmark."""
    weights: Path | None = None
    """Weights file; the one that ships with the package if not given."""
    threads: int | None = None
    """CPU threads of the network."""
    out: Path | None = None
    """Folder for report.json."""

    def _config(self) -> "PictureConfig":
        from icgnet.benchmark.pictures import PictureConfig

        return PictureConfig(self.scene, self.split, self.view, self.noise, self.scenes, self.seed)

    def _predictor(self) -> "Predictor":
        from icgnet.predictor import Predictor

        return Predictor.load(self.weights, self.threads)

    def _pictures(self, predictor: "Predictor") -> Iterator["Picture"]:
        """The pictures, with a bar that shows how many have been taken."""
        from icgnet.benchmark.pictures import take_pictures

        config, console = self._config(), Console(stderr=True)
        pictures = take_pictures(config, load_objects(self.objects), predictor.gripper)
        return iter(
            track(pictures, "scenes", config.scenes, console=console, transient=True, disable=not console.is_terminal)
        )

    def _weights_file(self) -> Path | None:
        """The file that the network comes from, if it comes from any."""
        from icgnet.predictor import DEFAULT_WEIGHTS

        return self.weights or DEFAULT_WEIGHTS

    def _settings(self) -> dict[str, object]:
        """What the numbers depend on, for the report."""
        from icgnet.benchmark.pictures import settings

        return settings(self._config(), self.objects, self._weights_file())

    def _title(self, name: str) -> str:
        return (
            f"{name}: {self.scenes} {self.scene} scenes of {self.split} objects from {self.objects}, view {self.view}, "
            f"noise {self.noise}, seed {self.seed}"
        )


@dataclass(frozen=True)
class Reconstruction(_OnPictures):
    """Predicted shapes against true ones: IoU, Chamfer-L1 and F-score, for whole scenes and single objects."""

    def run(self) -> None:
        """Measures, and prints a table.

        Raises:
            IcgnetError: unusable objects or weights, or settings out of range.
        """
        from icgnet.benchmark.reconstruction import score_shapes, summarise

        self._config()
        predictor = self._predictor()
        scenes = _some(score_shapes(predictor, self._pictures(predictor)), self.scenes)
        numbers = summarise(scenes)
        console = Console()
        console.print(self._title("reconstruction"), soft_wrap=True)
        console.print(_reconstruction_table(numbers))
        console.print(_reconstruction_lines(numbers), soft_wrap=True)
        rows = [asdict(scene) for scene in scenes]
        report = {"benchmark": "reconstruction", **asdict(numbers)}
        write_report(self.out, {**report, "settings": self._settings(), "rows": rows})


@dataclass(frozen=True)
class Segmentation(_OnPictures):
    """Predicted instances against true ones: mIoU, AP50, panoptic quality, classes and their confusion."""

    def run(self) -> None:
        """Measures, and prints two tables.

        Raises:
            IcgnetError: unusable objects or weights, or settings out of range.
        """
        from icgnet.benchmark.segmentation import score_masks, summarise

        self._config()
        predictor = self._predictor()
        scenes = _some(score_masks(predictor, self._pictures(predictor)), self.scenes)
        numbers = summarise(scenes)
        console = Console()
        console.print(self._title("segmentation"), soft_wrap=True)
        console.print(_segmentation_table(numbers))
        console.print(_confusion_table(numbers))
        console.print(f"{numbers.objects} visible objects in {numbers.scenes} scenes; {numbers.predicted} predicted")
        rows = [asdict(scene) for scene in scenes]
        report = {"benchmark": "segmentation", **asdict(numbers)}
        write_report(self.out, {**report, "settings": self._settings(), "rows": rows})


@dataclass(frozen=True)
class Latency(_OnPictures):
    """Time of each stage from a cloud or depth image to ranked, collision-checked grasps; size of the model."""

    scenes: int = 5
    """How many scenes, with one picture each."""
    repeats: int = 10
    """Timed predictions of each picture, after an untimed one."""
    input: Literal["cloud", "depth"] = "cloud"
    """What is given to the predictor: the fused cloud of the objects, or the depth image with the table."""
    preset: Literal["paper", "default", "tiny"] | None = None
    """Time an untrained network of this preset in place of weights; it finds other objects, so mind the stages."""

    def run(self) -> None:
        """Measures, and prints a table.

        Raises:
            IcgnetError: unusable objects or weights, settings out of range, or no scene with a cloud.
        """
        from icgnet.benchmark.latency import measure_latency, model_size

        self._config()
        if self.repeats < 1:
            raise InputError(f"repeats must be at least 1, got {self.repeats}")
        predictor = self._predictor()
        pictures = list(self._pictures(predictor))
        bar = Console(stderr=True)
        with Progress(console=bar, transient=True, disable=not bar.is_terminal) as progress:
            task = progress.add_task("calls", total=(self.repeats + 1) * len(pictures))
            numbers = measure_latency(predictor, pictures, self.repeats, self.input, lambda: progress.advance(task))
        size = model_size(predictor.network, self._weights_file())
        console = Console()
        console.print(self._title(f"latency of {self._model()}, input {self.input}"), soft_wrap=True)
        console.print(_latency_table(numbers))
        console.print(_latency_line(numbers, size), soft_wrap=True)
        settings = self._settings() | {"input": self.input, "repeats": self.repeats, "preset": self.preset}
        report = {"benchmark": "latency", **asdict(numbers), "model": asdict(size)}
        write_report(self.out, {**report, "settings": settings})

    def _predictor(self) -> "Predictor":
        if self.preset is None:
            return super()._predictor()
        if self.weights is not None:
            raise InputError("give --weights or --preset, not both: a preset is timed untrained")
        from icgnet.benchmark.latency import untrained_predictor

        return untrained_predictor(self.preset, self.threads)

    def _weights_file(self) -> Path | None:
        return None if self.preset else super()._weights_file()

    def _model(self) -> str:
        if self.preset is not None:
            return f"untrained preset {self.preset!r}"
        return "shipped weights" if self.weights is None else self.weights.name


def _some(scenes: Iterable[Any], asked: int) -> list[Any]:
    """The scenes that could be measured.

    Raises:
        InputError: there is none.
    """
    measured = list(scenes)
    if not measured:
        raise InputError(f"none of {asked} scenes has an object that can be seen: ask for more scenes")
    return measured


def _cells(value: "Spread | None", digits: int = 1) -> tuple[str, str]:
    """A number with its standard deviation over the scenes, and its 95 % interval."""
    if value is None:
        return "-", "-"
    return f"{value.mean:.{digits}f} ± {value.std:.{digits}f}", f"{value.low:.{digits}f}-{value.high:.{digits}f}"


def _reconstruction_table(numbers: "ReconstructionNumbers") -> Table:
    names = {
        "iou": ("IoU, %", 1),
        "chamfer_l1_mm": ("Chamfer-L1, mm", 2),
        "accuracy_mm": ("  accuracy", 2),
        "completeness_mm": ("  completeness", 2),
        "f_score_3mm": ("F-score 3 mm, %", 1),
        "f_score_10mm": ("F-score 10 mm, %", 1),
    }
    table = Table("± std over scenes", "scene", "95 %", "object found", "95 %")
    for name, (label, digits) in names.items():
        table.add_row(label, *_cells(numbers.scene[name], digits), *_cells(numbers.per_instance[name], digits))
    table.add_row("IoU, missed = 0, %", "", "", *_cells(numbers.per_instance["iou_of_visible"]))
    table.add_row("found, %", "", "", *_cells(numbers.per_instance["found"]))
    return table


def _reconstruction_lines(numbers: "ReconstructionNumbers") -> str:
    distance, share = _cells(numbers.outer["chamfer_l1_mm"], 2)[0], _cells(numbers.outer["f_score_3mm"])[0]
    return (
        f"3 mm is 1 % of the workspace. Against the outer true surface only: Chamfer-L1 {distance} mm, "
        f"F-score at 3 mm {share} %.\n{numbers.matched} of {numbers.visible} visible objects found; "
        f"{numbers.without_shape} of {numbers.scenes} scenes without any predicted shape."
    )


def _segmentation_table(numbers: "SegmentationNumbers") -> Table:
    table = Table("percent ± std over scenes", "all scenes", "95 %")
    labels = {
        "instance mIoU": numbers.instance_miou,
        "AP50, ranked by the object's score": numbers.ap50,
        "panoptic quality, any class": numbers.pq,
        "  segmentation quality": numbers.sq,
        "  recognition quality": numbers.rq,
        "panoptic quality, right class": numbers.class_pq,
        "class accuracy of the matches": numbers.class_accuracy,
        "  or the class that the labels name as alternative": numbers.class_accuracy_alternative,
    }
    for label, value in labels.items():
        table.add_row(label, *_cells(value))
    return table


def _confusion_table(numbers: "SegmentationNumbers") -> Table:
    """Rows are true classes, columns predicted ones; empty rows are left out."""
    columns = list(next(iter(numbers.confusion.values())))
    table = Table("true \\ predicted", *columns, title="classes: number of objects")
    for name, row in numbers.confusion.items():
        if any(row.values()):
            table.add_row(name, *(str(row[column] or "") for column in columns))
    return table


def _latency_table(numbers: "LatencyNumbers") -> Table:
    table = Table("stage, ms", "median", "10th to 90th percentile")
    for stage, median in numbers.stages_ms.items():
        if stage == "meshes":
            continue
        table.add_row(
            stage, f"{median:.0f}", f"{numbers.stages_p10_ms[stage]:.0f} to {numbers.stages_p90_ms[stage]:.0f}"
        )
    table.add_section()
    table.add_row(
        "whole, to ranked grasps", f"{numbers.median_ms:.0f}", f"{numbers.p10_ms:.0f} to {numbers.p90_ms:.0f}"
    )
    table.add_section()
    spread = f"{numbers.stages_p10_ms['meshes']:.0f} to {numbers.stages_p90_ms['meshes']:.0f}"
    table.add_row("meshes of all objects", f"{numbers.stages_ms['meshes']:.0f}", spread)
    return table


def _latency_line(numbers: "LatencyNumbers", size: "ModelSize") -> str:
    from icgnet.benchmark.record import origin

    file = "" if size.file_bytes is None else f", {size.file_bytes / 1e6:.1f} MB on disk"
    return (
        f"{numbers.calls} calls; {numbers.points:.0f} points, {numbers.objects:.1f} objects, "
        f"{numbers.grasps:.0f} grasps; {numbers.device}, {numbers.threads} threads, {origin().processor}; "
        f"{size.parameters / 1e6:.2f} M parameters, {size.bytes / 1e6:.1f} MB in memory{file}"
    )

"""Everything that a training run depends on, and the named presets."""

import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from icgnet.errors import DataError, InputError
from icgnet.files import write_json
from icgnet.network.config import NETWORKS, NetworkConfig, Precision
from icgnet.sensors.config import CAMERAS, NOISES, SensorNoise, exactly, up_to
from icgnet.settings import check_choices, check_range


@dataclass(frozen=True)
class ViewRange:
    """Cameras on a part of a sphere around a point above the workspace's centre.

    Attributes:
        share: how often this range is drawn, relative to the other ranges.
        radius: least and largest distance of the camera [m].
        polar_deg: least and largest angle from the vertical [degrees].
        target: least and largest height that the camera looks at [m].
    """

    share: float
    radius: tuple[float, float]
    polar_deg: tuple[float, float]
    target: tuple[float, float]


VIEW_RANGES = (
    ViewRange(0.40, (0.45, 0.75), (0.0, 45.0), (0.0, 0.25)),
    ViewRange(0.40, (0.55, 0.75), (40.0, 62.0), (0.15, 0.25)),
    ViewRange(0.10, (0.45, 0.75), (0.0, 4.0), (0.0, 0.25)),
    ViewRange(0.10, (0.45, 0.75), (60.0, 75.0), (0.05, 0.25)),
)
"""Seen from above to obliquely, as published for training; the benchmark's view; straight down; and nearly level.

Paper: "Observations" (polar 0 to 45 degrees). Differs: the benchmark looks from 45 to 60 degrees, so these are in.
"""

TABLE_VIEWS = (
    ViewRange(0.35, (0.35, 1.4), (0.0, 35.0), (0.05, 0.15)),
    ViewRange(0.50, (0.45, 1.4), (35.0, 62.0), (0.05, 0.15)),
    ViewRange(0.15, (0.45, 1.4), (62.0, 75.0), (0.05, 0.15)),
)
"""Around a place on a table: on a robot's wrist, on a stand, nearly level."""

BIN_VIEWS = (
    ViewRange(0.60, (0.45, 1.4), (0.0, 25.0), (0.05, 0.15)),
    ViewRange(0.40, (0.45, 1.4), (25.0, 55.0), (0.05, 0.15)),
)
"""Around a place in a bin, whose walls hide it from the side."""

EVALUATION_VIEWS = (
    ViewRange(0.5, (0.48, 0.72), (0.0, 45.0), (0.0, 0.0)),
    ViewRange(0.5, (0.60, 0.75), (45.0, 60.0), (0.25, 0.25)),
)
"""The published views of training and of the benchmark, for validation."""


@dataclass(frozen=True)
class LossWeights:
    """Factors of the terms of the loss; a scene-level term with factor 0 is not computed.

    Attributes:
        class_: cross-entropy of the queries' classes.
        mask: binary cross-entropy of matched masks.
        dice: dice loss of matched masks.
        vote: how far the voxels' votes are from the middle of their object, and whether they are nearer to another's.
        occupancy: binary cross-entropy of each instance's occupancy.
        grasp: binary cross-entropy of the twelve angles.
        contact: binary cross-entropy of the contact's own score, whether any angle succeeds.
        width: squared error of the width.
        scene_occupancy: as `occupancy`, for the maximum over instances against the union.
        scene_grasp: as `grasp`, for the maximum over instances.
        no_object: weight in the class term of queries that shall say "no object".
        seeded: every query learns the object that it was seeded on, instead of one query per object.
        every_instance: decode each contact and point with every instance (published), instead of contacts with
            their own and points with the nearest and another one.
        divide_by_terms: divide the sum by the number of terms (published), instead of averaging over stages.
    """

    class_: float = 6.0
    mask: float = 5.0
    dice: float = 2.0
    vote: float = 4.0
    occupancy: float = 20.0
    grasp: float = 10.0
    contact: float = 1.0
    width: float = 0.5
    scene_occupancy: float = 0.0
    scene_grasp: float = 0.0
    no_object: float = 0.3
    seeded: bool = True
    every_instance: bool = False
    divide_by_terms: bool = False

    def __post_init__(self) -> None:
        check_range(self, 0.0, *(name for name, value in vars(self).items() if not isinstance(value, bool)))


PUBLISHED = LossWeights(
    class_=10.0,
    mask=5.0,
    dice=2.0,
    vote=0.0,
    occupancy=5.0,
    grasp=5.0,
    contact=0.0,
    width=1.0,
    scene_occupancy=2.0,
    scene_grasp=10.0,
    no_object=0.1,
    seeded=False,
    every_instance=True,
    divide_by_terms=True,
)


@dataclass(frozen=True)
class MatchingCosts:
    """Weights of the three parts of the assignment cost.

    With seeded queries only the best of an object's own queries is looked for, and the mask says which that is.
    """

    class_probability: float = 2.0
    mask: float = 5.0
    dice: float = 5.0

    def __post_init__(self) -> None:
        check_range(self, 0.0, "class_probability", "mask", "dice")


PUBLISHED_COSTS = MatchingCosts(class_probability=10.0, mask=5.0, dice=2.0)


@dataclass(frozen=True)
class Sampling:
    """How a recipe becomes a sample.

    Attributes:
        views: where cameras may stand.
        noise: what the sensor does.
        table_views: where cameras may stand around a place on a table.
        bin_views: the same in a bin.
        cameras: names of those that see tables and bins, each with its own noise.
        crop: edge of the part of a table or bin that a visit shows [m].
        tsdf: share of visits of packed and pile scenes whose cloud comes from a truncated signed distance grid instead
            of the pixels themselves.
        half_resolution: share of the other visits with 320 x 240 instead of 640 x 480 pixels.
        table_jitter: largest error of the height at which the table is cut off [m].
        turn: whether everything is turned about the vertical through the workspace's centre.
        translation: largest shift along x and y [m].
        viewpoint_drop: share of visits without a known viewpoint.
        fewest_voxels: voxels that an object must show to be an instance.
        occupancy_points: points per scene where shapes are asked for.
        near_share: share of them within about 7 mm of a surface.
        far_share: share of them within about 2 cm of a surface; the rest is uniform.
        points_near_objects: draw the uniform points in the box around the objects + 2 cm, not in the whole cube.
        contacts: contacts per scene.
        balanced_contacts: take half of them from those where any angle succeeded, and prefer the seen.
        seen_share: share of contacts on seen surfaces, where there are enough.
        contact_jitter: standard deviation of the contacts' positions [m].
        normal_jitter_deg: standard deviation of the normals' directions [degrees].
    """

    views: tuple[ViewRange, ...] = VIEW_RANGES
    noise: SensorNoise = NOISES["mixed"]
    table_views: tuple[ViewRange, ...] = TABLE_VIEWS
    bin_views: tuple[ViewRange, ...] = BIN_VIEWS
    cameras: tuple[str, ...] = tuple(CAMERAS)
    crop: float = 0.4
    tsdf: float = 0.4
    half_resolution: float = 0.5
    table_jitter: float = 0.0015
    turn: bool = True
    translation: float = 0.02
    viewpoint_drop: float = 0.1
    fewest_voxels: int = 10
    occupancy_points: int = 2048
    near_share: float = 0.5
    far_share: float = 0.3
    points_near_objects: bool = True
    contacts: int = 96
    balanced_contacts: bool = True
    seen_share: float = 0.75
    contact_jitter: float = 0.001
    normal_jitter_deg: float = 4.0

    def __post_init__(self) -> None:
        if self.near_share + self.far_share > 1:
            raise InputError(f"near_share {self.near_share} + far_share {self.far_share} must not exceed 1")
        shares = ("tsdf", "half_resolution", "viewpoint_drop", "near_share", "far_share", "seen_share")
        check_range(self, 0.0, *shares, most=1.0)
        check_range(self, 0.0, "table_jitter", "translation", "contact_jitter", "normal_jitter_deg", "contacts")
        check_range(self, 1.0, "fewest_voxels", "occupancy_points")
        check_range(self, 0.2, "crop", most=0.8)
        for name in self.cameras:
            if name not in CAMERAS:
                raise InputError(f"unknown camera {name!r}; the cameras are {', '.join(CAMERAS)}")

    def for_validation(self) -> "Sampling":
        """The same without augmentation, with the published views and noise, and with all contacts.

        The clouds are raw pixels with Gaussian noise, whatever is trained with, so that runs compare over time.
        """
        return replace(
            self,
            views=EVALUATION_VIEWS,
            noise=NOISES["gaussian"],
            tsdf=0.0,
            half_resolution=0.0,
            table_jitter=0.0,
            turn=False,
            translation=0.0,
            viewpoint_drop=0.0,
            occupancy_points=4096,
            near_share=0.0,
            far_share=0.0,
            points_near_objects=True,
            contacts=512,
            balanced_contacts=False,
            contact_jitter=0.0,
            normal_jitter_deg=0.0,
        )


@dataclass(frozen=True)
class TrainingConfig:
    """A training run. Give either `steps` or `minutes`; the learning rate is at its floor when they are used up.

    Attributes:
        network: name of a network preset.
        sampling: how recipes become samples.
        loss: factors of the loss terms.
        matching: costs of the assignment between queries and instances.
        seed: of the network's initial weights and of all draws.
        steps: optimiser steps of the run.
        minutes: training time of the run, summed over its legs [min].
        batch: scenes per optimiser step, in each process that trains.
        common_statistics: batch normalisation takes its statistics over the scenes of all processes, as one process
            with all of them would; otherwise each process over its own, without waiting for the others in every layer.
        optimizer: "muon", or "adamw" (published).
        learning_rate: after the warm-up.
        final_learning_rate: at the end of the cosine, as a fraction of `learning_rate`.
        warmup_steps: steps in which the learning rate rises from 0.
        weight_decay: of the optimiser, apart from the gradient.
        gradient_clip: largest norm of the gradient; 0 means no limit.
        average_decay: of the exponential moving average of the weights, which is validated and shipped.
        precision: in how many bits the forward pass of the U-Nets computes; auto takes bfloat16 where the processor or
            card has instructions for it, else float32.
        threads: of the computation, in each process that trains.
        workers: processes that prepare samples; 0 prepares them in between the steps.
        log_seconds: time between two lines about training [s].
        validation_minutes: time between two validations [min].
        validation_scenes: held-out scenes that are looked at then.
        checkpoint_minutes: time between two checkpoints [min].
    """

    network: str = "default"
    sampling: Sampling = field(default_factory=Sampling)
    loss: LossWeights = field(default_factory=LossWeights)
    matching: MatchingCosts = field(default_factory=MatchingCosts)
    seed: int = 0
    steps: int | None = None
    minutes: float | None = 90.0
    batch: int = 2
    common_statistics: bool = True
    optimizer: Literal["muon", "adamw"] = "muon"
    learning_rate: float = 1e-3
    final_learning_rate: float = 0.01
    warmup_steps: int = 100
    weight_decay: float = 0.01
    gradient_clip: float = 5.0
    average_decay: float = 0.998
    precision: Precision = "auto"
    threads: int = 1
    workers: int = 1
    log_seconds: float = 20.0
    validation_minutes: float = 15.0
    validation_scenes: int = 48
    checkpoint_minutes: float = 3.0

    def __post_init__(self) -> None:
        check_choices(self)
        if self.network not in NETWORKS:
            raise InputError(f"unknown network {self.network!r}; the presets are {', '.join(NETWORKS)}")
        if (self.steps is None) == (self.minutes is None):
            raise InputError(
                f"give either steps or minutes, and None for the other, got steps {self.steps}, minutes {self.minutes}"
            )
        check_range(self, 1.0, "steps", "batch", "threads")
        check_range(self, 0.0, "minutes", "learning_rate", above=True)
        not_negative = ("workers", "warmup_steps", "weight_decay", "gradient_clip", "validation_scenes", "seed")
        check_range(self, 0.0, *not_negative, "log_seconds", "validation_minutes", "checkpoint_minutes")
        check_range(self, 0.0, "average_decay", "final_learning_rate", most=1.0)

    def progress(self, step: int, elapsed: float) -> float:
        """Used share of the budget, 0 to 1, after `step` steps and `elapsed` seconds of training."""
        if self.minutes is not None:
            return min(1.0, elapsed / (60.0 * self.minutes))
        assert self.steps is not None
        return min(1.0, step / self.steps)


TRAININGS = {
    "tiny": TrainingConfig(
        network="tiny",
        sampling=Sampling(occupancy_points=128, contacts=16, tsdf=0.0, half_resolution=1.0),
        steps=20,
        minutes=None,
        batch=2,
        warmup_steps=2,
        average_decay=0.9,
        precision="float32",
        threads=1,
        workers=0,
        validation_scenes=2,
    ),
    "cpu": TrainingConfig(common_statistics=False),
    "paper": TrainingConfig(
        network="paper",
        sampling=Sampling(
            views=(ViewRange(1.0, (0.48, 0.72), (0.0, 45.0), (0.0, 0.0)),),
            noise=SensorNoise(drop=up_to(0.3), blocks=exactly(0.2), deformation=exactly(0.001), gaussian=up_to(0.002)),
            tsdf=0.0,
            half_resolution=0.0,
            translation=0.0,
            occupancy_points=32768,
            near_share=0.3,
            far_share=0.0,
            points_near_objects=False,
            contacts=128,
        ),
        loss=PUBLISHED,
        matching=PUBLISHED_COSTS,
        steps=101250,
        minutes=None,
        batch=8,
        optimizer="adamw",
        warmup_steps=800,
        gradient_clip=0.0,
        average_decay=0.999,
        workers=4,
    ),
}
"""Presets: `tiny` for tests, `cpu` for two cores and an evening, `paper` as published (60 epochs of 13,500 scenes)."""

CONFIG_FILE = "config.json"
INDIFFERENT = (
    "training.batch",
    "training.common_statistics",
    "training.threads",
    "training.workers",
    "training.precision",
    "training.log_seconds",
    "training.checkpoint_minutes",
    "data.scenes",
    "data.validation_scenes",
)
"""What may change between the legs of a run: how fast it trains, also at the price of other gradients (precision, own
statistics), how often it reports, and data that have grown.

The batch of a process may, too, because the number of scenes in a step, over all processes, may not.
"""


def write_or_compare(out: Path, content: dict[str, Any]) -> list[str]:
    """Writes the configuration of a run, after making sure that a run which is already there has the same.

    Returns:
        What differs from the run that is there, among the settings that may: then the run goes on, but it is not the
        one that a single leg would have given.

    Raises:
        DataError: the folder holds a run with other settings, which the message names, or a file that is damaged.
    """
    path = out / CONFIG_FILE
    changes: dict[str, str] = {}
    if path.is_file():
        before, now = _flatten(_read(path)), _flatten(json.loads(json.dumps(content)))
        # Folders from before several processes could train do not say it.
        before.setdefault("scenes_per_step", before.get("training.batch"))
        before.setdefault("training.common_statistics", now.get("training.common_statistics"))
        keys = sorted(key for key in before.keys() | now.keys() if before.get(key) != now.get(key))
        changes = {key: f"{key}: {before.get(key)} there, {now.get(key)} now" for key in keys}
        forbidden = [change for key, change in changes.items() if key not in INDIFFERENT]
        if forbidden:
            raise DataError(f"{out} holds a run with other settings; {'; '.join(forbidden)}")
    write_json(path, content)
    return list(changes.values())


def training_record(
    config: TrainingConfig, network: NetworkConfig, processes: int, data: dict[str, Any]
) -> dict[str, Any]:
    """The configuration, that of the network and the data as plain values, for `config.json`."""
    return {
        "training": asdict(config),
        "scenes_per_step": config.batch * processes,
        "network": network.to_dict(),
        "data": data,
    }


def _read(path: Path) -> Any:
    try:
        return json.loads(path.read_text())
    except ValueError as error:
        raise DataError(f"{path} is damaged ({error}): put it right, or name another folder for the run") from error


def _flatten(content: Any, prefix: str = "") -> dict[str, Any]:
    if not isinstance(content, dict):
        return {prefix: content}
    return {
        key: value for name, inner in content.items() for key, value in _flatten(inner, _join(prefix, name)).items()
    }


def _join(prefix: str, name: str) -> str:
    return f"{prefix}.{name}" if prefix else name

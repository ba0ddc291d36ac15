"""Sizes and choices of the network, and the named presets."""

from dataclasses import asdict, dataclass, fields
from typing import Any, Literal

from icgnet.errors import InputError


@dataclass(frozen=True)
class HandConfig:
    """Where the hand-aligned decoder looks, in the frame of the hand at the contact, and its layer widths.

    The control points are all combinations of the three lists of offsets.
    """

    normal: tuple[float, ...] = (0.020, 0.008, -0.020, -0.040, -0.060, -0.080, -0.100)
    """Offsets along the outward surface normal [m]: negative is through the object, towards the other finger."""
    approach: tuple[float, ...] = (-0.070, -0.035, 0.0, 0.015)
    """Offsets along the approach direction [m]: negative is towards the palm."""
    sideways: tuple[float, ...] = (-0.012, 0.012)
    """Offsets across the fingers [m]."""
    rays: tuple[float, ...] = tuple(round(0.02 - 0.01 * step, 3) for step in range(12))
    """Offsets along the normal that the width head reads [m]: every centimetre from +20 mm to -90 mm."""
    map_channels: int = 8
    """Channels that the finest dense map is projected to before it is read."""
    hidden: int = 128
    contact_width: int = 64
    width_limit: float = 0.09
    """Largest opening that the width head can name [m]: a little above the hand's, so that 80 mm is not its limit."""

    @property
    def points(self) -> int:
        """Number of control points."""
        return len(self.normal) * len(self.approach) * len(self.sideways)


@dataclass(frozen=True)
class NetworkConfig:
    """Everything that determines the shape and the meaning of a network's weights."""

    name: str = "default"
    voxel_size: float = 0.003
    """Pitch of the sparse voxels [m]."""
    dense_pitch: float = 0.010
    """Cell size of the dense grid [m]."""
    dense_cells: int = 30
    """Cells per axis of the dense grid: it covers [0, dense_cells * dense_pitch] exactly."""
    visibility: bool = True
    """Whether the dense part also sees which space is free and which is hidden (two more channels)."""
    point_inputs: bool = True
    """Whether both U-Nets see where in a voxel or cell its points lie, and the sparse one its height above the table;
    the published inputs are whether a voxel or cell holds points."""

    local_moments: bool = True
    """Whether the sparse part sees how the points lie around every voxel: what their normals would be taken from."""

    stem_width: int = 8
    encoder_widths: tuple[int, ...] = (16, 32, 64, 128)
    decoder_widths: tuple[int, ...] = (64, 64, 32, 32)
    dilations: tuple[int, ...] = (1, 2, 2, 2, 2, 2, 2, 1)
    batch_norm_momentum: float = 0.02
    dense_widths: tuple[int, ...] = (16, 32, 64, 128)

    queries: int = 32
    query_width: int = 32
    heads: int = 8
    token_feed_forward: int = 64
    feed_forward: int = 128
    affordance_feed_forward: int = 512
    affordance_rounds: int = 2
    tokens_per_level: tuple[int, ...] = (800, 3200, 4096, 8192)
    """At most so many tokens are attended per level while training, coarse to fine; all of them in evaluation."""
    attention_threshold: float = 0.5
    """A token whose pooled mask probability is below this is blocked in the query's cross-attention."""

    position_scale: Literal["cloud", "workspace"] = "workspace"
    """What the positional encoding is normalised by: bounds of the visible cloud (published) or the fixed workspace."""
    fourier_scale: float = 2.0
    seeded_masks: bool = True
    """Whether a query's mask also depends on where the query was seeded, or on the features alone (published)."""
    seeded_content: bool = True
    """Whether a query starts from the features where it was seeded, or from learnt content alone (published)."""
    class_of_mask: bool = True
    """Whether the class is read from the mask's mean features and extent, too, or from the query alone (published)."""
    classes: int = 7
    """Real classes; the class head has one more logit, the last, for no object."""

    coarse_volume: int = 32
    """Channels in which the decoders also see the coarser dense maps at a point; 0 for the finest map alone
    (published)."""
    neighbours: int = 6
    view_depth: bool = True
    """Whether features at a point know how far behind its neighbours it lies, along the lines of sight to these."""
    decoder_width: int = 32
    decoder_blocks: int = 5
    decoder_stages: Literal["all", "final"] = "final"
    """Whether the queries of every refinement stage can be decoded (published), or only the final ones."""
    affordance: Literal["contact", "hand"] = "hand"
    """Affordance read at the contact, 12 logits at once (published), or at points of the hand, angle by angle."""
    approach_angles: int = 12
    hand: HandConfig = HandConfig()

    def __post_init__(self) -> None:
        levels = len(self.encoder_widths)
        if not len(self.decoder_widths) == len(self.dense_widths) == len(self.tokens_per_level) == levels == 4:
            raise InputError("the network has four levels: give four widths for encoder, decoder and dense part")
        if len(self.dilations) != 2 * levels:
            raise InputError(f"dilations: {2 * levels} values expected, got {len(self.dilations)}")
        if self.query_width % self.heads or self.query_width % 2:
            raise InputError(f"query_width {self.query_width} must be even and divisible by heads ({self.heads})")

    @property
    def dense_channels(self) -> int:
        """Input channels of the dense part.

        Occupancy; with `visibility` its value and a known flag; with `point_inputs` the mean offset of a cell's points.
        """
        return 1 + 2 * self.visibility + 3 * self.point_inputs

    @property
    def surface_channels(self) -> int:
        """Input channels of the sparse part.

        1; with `point_inputs` offset in the voxel and height; with `local_moments` mean and covariance of the points
        around.
        """
        return 1 + 4 * self.point_inputs + 9 * self.local_moments

    @property
    def stages(self) -> int:
        """Predictions that the refinement makes: one before each level and one after the last."""
        return len(self.tokens_per_level) + 1

    @property
    def decoded_stages(self) -> tuple[int, ...]:
        """Indices of the stages that the decoders may be asked for."""
        return tuple(range(self.stages)) if self.decoder_stages == "all" else (self.stages - 1,)

    def to_dict(self) -> dict[str, Any]:
        """The configuration as plain values, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "NetworkConfig":
        """The configuration that `to_dict` wrote.

        Raises:
            InputError: for unknown or missing fields, or values that make no network.
        """
        hand_values = values.get("hand")
        if set(values) != {field.name for field in fields(cls)} or not isinstance(hand_values, dict):
            unknown = sorted(set(values) ^ {field.name for field in fields(cls)})
            raise InputError(f"not a network configuration: fields {unknown} are unknown or missing")
        if set(hand_values) != {field.name for field in fields(HandConfig)}:
            raise InputError("not a network configuration: the fields of 'hand' differ")
        hand = HandConfig(**{key: _frozen(value) for key, value in hand_values.items()})
        return cls(**{**{key: _frozen(value) for key, value in values.items()}, "hand": hand})


def _frozen(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


NETWORKS = {
    "paper": NetworkConfig(
        name="paper",
        visibility=False,
        point_inputs=False,
        local_moments=False,
        view_depth=False,
        position_scale="cloud",
        seeded_masks=False,
        seeded_content=False,
        class_of_mask=False,
        coarse_volume=0,
        decoder_stages="all",
        affordance="contact",
    ),
    "default": NetworkConfig(),
    "tiny": NetworkConfig(
        name="tiny",
        stem_width=4,
        encoder_widths=(4, 8, 8, 8),
        decoder_widths=(8, 8, 8, 8),
        dense_widths=(4, 4, 8, 8),
        coarse_volume=4,
        queries=8,
        query_width=8,
        heads=2,
        token_feed_forward=16,
        feed_forward=16,
        affordance_feed_forward=16,
        tokens_per_level=(100, 200, 400, 800),
        decoder_width=16,
        decoder_blocks=2,
        hand=HandConfig(map_channels=4, hidden=16, contact_width=16),
    ),
}
"""Presets: `paper` as published, `default` ours, `tiny` for tests."""

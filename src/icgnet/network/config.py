"""Sizes and choices of the network, and the named presets."""

from dataclasses import asdict, dataclass
from typing import Any, Literal

from icgnet.errors import InputError
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.grasping.hand_family import HandFamily, outside
from icgnet.objects.classes import CLASSES, check_class_list
from icgnet.settings import check_choices, check_range, read_settings

Precision = Literal["auto", "float32", "bfloat16"]
"""In how many bits the U-Nets compute; auto is bfloat16 where the processor or card has instructions for it."""

FRANKA, FAMILY = load_gripper("franka"), HandFamily()
LARGEST_OFFSET, LARGEST_FACTOR = 0.5, 10.0
MOST_RAYS = 100.0
WIDEST_LAYER = 4096.0


def _shown(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)


def _check_items(settings: Any, name: str, least: float, most: float, longest: int = 16) -> None:
    """Makes sure that a field of settings is a tuple of 1 to `longest` finite numbers in a range.

    Raises:
        InputError: it is not.
    """
    values = getattr(settings, name)
    numbers = isinstance(values, tuple) and all(isinstance(value, int | float) for value in values)
    if not numbers or not 0 < len(values) <= longest or not all(least <= value <= most for value in values):
        raise InputError(f"{name} must be 1 to {longest} numbers from {least:g} to {most:g}, got {repr(values)[:80]}")


@dataclass(frozen=True)
class HandConfig:
    """Where the hand-aligned decoder looks, in terms of the hand that grasps, and its layer widths.

    The control points are all combinations of the offsets along the surface normal (outward, then across), along the
    approach and sideways. For the Franka hand they reach from 20 mm outside of the contact to 100 mm behind it, and
    from 15 mm past it to 71 mm before it.
    """

    outward: tuple[float, ...] = (1.2, 0.5)
    """Offsets along the outward surface normal, where the finger is, by the thickness of its tip."""
    across: tuple[float, ...] = (0.25, 0.5, 0.75, 1.0, 1.25)
    """Offsets against the normal, through the object and to the other finger, by the largest opening."""
    finger: tuple[float, ...] = (1.0, 0.5, 0.0)
    """Offsets against the approach, by how far the palm is from the contact."""
    palm: float = 0.035
    """One more offset, so far into the palm [m]."""
    past_tip: float = 0.005
    """And one along the approach, so far past the tips [m]."""
    sideways: tuple[float, ...] = (-0.57, 0.57)
    """Offsets across the fingers, by their width."""
    rays: int = 9
    """Steps in which the width head reads along the normal, to a little more than the largest opening; it reads at the
    contact and at two places outside of it, too."""
    map_channels: int = 8
    """Channels that the finest dense map is projected to before it is read."""
    hidden: int = 128
    contact_width: int = 64

    def __post_init__(self) -> None:
        for name in ("outward", "across", "finger", "sideways"):
            _check_items(self, name, -LARGEST_FACTOR, LARGEST_FACTOR)
        check_range(self, 0.0, "palm", "past_tip", most=LARGEST_OFFSET)
        check_range(self, 1.0, "rays", most=MOST_RAYS)
        check_range(self, 1.0, "map_channels", "hidden", "contact_width", most=WIDEST_LAYER)

    @property
    def points(self) -> int:
        """Number of control points."""
        return (len(self.outward) + len(self.across)) * (len(self.finger) + 2) * len(self.sideways)


@dataclass(frozen=True)
class NetworkConfig:
    """Everything that determines the shape and the meaning of a network's weights."""

    name: str = "default"
    gripper: Gripper = FRANKA
    """The hand of the labels, or most of them. A network of the published kind scores grasps for this one only."""
    classes: tuple[str, ...] = CLASSES
    """Names of the classes, in the order of the class logits; one more logit, the last, is for no object."""
    voxel_size: float = 0.003
    """Pitch of the sparse voxels [m]."""
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

    any_extent: bool = True
    """Whether a scene may be of any extent: queries are seeded by area, know places relative to their seeds only and
    look no farther than `reach`, and the dense part stays near the points. Otherwise, as published, there is a fixed
    number of queries, and the bounds of the cloud are the unit of all places."""
    queries: int = 32
    """Number of queries, if it is fixed."""
    seed_spacing: float = 0.03
    """Else the least distance of their seeds [m]."""
    reach: float = 0.35
    """And how far from its seed a query attends, and its mask extends [m]."""
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

    fourier_scale: float = 2.0
    seeded_masks: bool = True
    """Whether a query's mask also depends on where the query was seeded, or on the features alone (published)."""
    votes: bool = True
    """Whether a seeded mask also depends on where the voxels say that the middle of their object is."""
    seeded_content: bool = True
    """Whether a query starts from the features where it was seeded, or from learnt content alone (published)."""
    class_of_mask: bool = True
    """Whether the class is read from the mask's mean features and extent, too, or from the query alone (published)."""
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
    hand: HandConfig = HandConfig()
    family: HandFamily = FAMILY
    """The hands that a network for any of them has learned from."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_class_list(self.classes)
        check_range(self, 0.001, "voxel_size", most=0.05)
        check_range(self, 0.01, "seed_spacing", "reach", most=2.0)
        check_range(self, 0.0, "batch_norm_momentum", "attention_threshold", most=1.0)
        check_range(self, 0.0, "fourier_scale", most=1000.0)
        widths = ("stem_width", "query_width", "token_feed_forward", "feed_forward", "affordance_feed_forward")
        check_range(self, 1.0, *widths, "decoder_width", most=WIDEST_LAYER)
        check_range(self, 1.0, "queries", "heads", "neighbours", "affordance_rounds", "decoder_blocks", most=1000.0)
        check_range(self, 0.0, "coarse_volume", most=WIDEST_LAYER)
        for name in ("encoder_widths", "decoder_widths", "dense_widths"):
            _check_items(self, name, 1.0, WIDEST_LAYER)
        _check_items(self, "dilations", 1.0, 64.0)
        _check_items(self, "tokens_per_level", 1.0, 1e9)
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
    def any_hand(self) -> bool:
        """Whether grasps are scored for the hand that is asked for, and not only for that of the labels."""
        return self.affordance == "hand"

    @property
    def most_instances(self) -> int | None:
        """How many objects of a scene can be told apart, None for any number."""
        return None if self.any_extent else self.queries

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
        return asdict(self) | {"gripper": self.gripper.to_dict()}

    @classmethod
    def from_dict(cls, values: Any) -> "NetworkConfig":
        """The configuration that `to_dict` wrote.

        Raises:
            InputError: for unknown or missing fields, values of the wrong type, or values that make no network.
        """
        return read_settings(cls, values)

    def differences(self, stored: "NetworkConfig") -> list[str]:
        """In what a stored configuration differs from this one.

        Grippers that are the same hand do not, and no hands where the network takes any.
        """
        wanted, found = self.to_dict(), stored.to_dict()
        changes = [
            f"{key} is {_shown(found[key])}, wanted {_shown(wanted[key])}"
            for key in wanted
            if key != "gripper" and wanted[key] != found[key]
        ]
        phrases = self.gripper.differences(stored.gripper)
        hands = [f"its hand is {stored.gripper.name!r}, wanted {self.gripper.name!r} with {', '.join(phrases)}"]
        return hands * bool(phrases and not self.any_hand) + changes

    def doubts(self, gripper: Gripper) -> tuple[str, ...]:
        """What speaks against scores for a hand, one sentence each: that it is unlike all that was learned from."""
        found = outside(self.family, gripper) if self.any_hand else []
        if not found:
            return ()
        return (f"the hand {gripper.name!r} is outside of what the network has learned from: {'; '.join(found)}",)

    def check_hand(self, gripper: Gripper, whose: str) -> None:
        """Makes sure that a hand is the one that the network knows, if it knows only one; name and base may differ.

        Args:
            gripper: the hand.
            whose: what it belongs to, for the message: "the scenes in data/train".

        Raises:
            InputError: it is another one.
        """
        if not self.any_hand and not self.gripper.same_hand(gripper):
            raise InputError(
                f"{whose} have the hand {gripper.name!r}, but the weights know only {self.gripper.name!r} "
                f"({gripper.name!r} has {', '.join(gripper.differences(self.gripper))})"
            )


NETWORKS = {
    "paper": NetworkConfig(
        name="paper",
        visibility=False,
        point_inputs=False,
        local_moments=False,
        view_depth=False,
        any_extent=False,
        seeded_masks=False,
        votes=False,
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

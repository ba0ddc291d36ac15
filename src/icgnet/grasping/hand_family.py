"""The family of parallel-jaw hands that networks for any hand learn from, and the few numbers that describe one."""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

from icgnet.errors import InputError
from icgnet.grasping.gripper import MATING_DEPTH, RANGES, TOUCH, Gripper, extents
from icgnet.settings import check_range

Range = tuple[float, float]
NUMBERS = (
    "opening",
    "finger_length",
    "tip_width",
    "tip_thickness",
    "finger_width",
    "finger_thickness",
    "palm_width",
    "palm_length",
    "palm_depth",
    "finger_reach",
    "clearance",
)
"""What `hand_numbers` gives, in this order, each in metres; `HandFamily` says what each means and its range."""
DIGITS, ROUNDING = 4, 1e-4
"""Members are rounded to 0.1 mm, and may be outside of their ranges by as much [m]."""
STAND_BACK = 0.002
"""The finger behind the pad stands back by this [m]: two flush boxes would double the contacts."""
PAD_MARGIN = 0.01
"""The pad reaches at least this far past the contact, on the side of the palm [m]."""
LARGEST = 0.25
"""No number of a family is larger [m], so that all of a member is within the limits of gripper files."""
PAD_SHARE = (0.4, 1.0)
"""Of the finger's length that is pad, from the tip."""
WRIST_SHARE = 0.5
"""Of the members whose palm is a body and a narrower wrist behind it."""
BODY_SHARE, WRIST_SIZE = (0.4, 0.7), (0.5, 0.9)
"""How much of such a palm's depth is body, and the wrist's width and length in terms of the body's."""


@dataclass(frozen=True)
class HandFamily:
    """Ranges [m] that hands are drawn from: each number evenly between the two, ends included."""

    base_share: float = 0.4
    """Of the scenes that get the base hand itself, not one of the family."""
    opening: Range = (0.04, 0.15)
    """Largest distance between the pads."""
    finger_length: Range = (0.03, 0.14)
    """From the palm, or the rear of a finger without a palm, to the tips."""
    tip_width: Range = (0.008, 0.033)
    """Of the boxes that end in the tip, along x."""
    tip_thickness: Range = (0.005, 0.025)
    """Of the boxes that end in the tip, along y."""
    finger_width: Range = (0.008, 0.04)
    """Of the whole finger, along x."""
    finger_thickness: Range = (0.005, 0.045)
    """Of the whole finger, along y."""
    palm_width: Range = (0.03, 0.09)
    """Along x, across the closing direction."""
    palm_length: Range = (0.06, 0.25)
    """Along y, the closing direction."""
    palm_depth: Range = (0.05, 0.16)
    """Along z, the approach."""
    finger_reach: Range = (0.006, 0.015)
    """How far the tips reach past a contact."""
    clearance: Range = (0.004, 0.01)
    """Free space beside each finger while approaching."""
    finger_force: Range = (15.0, 40.0)
    """Of each finger [N]; 12 N hold 0.7 kg at a friction of 0.6 while it is lifted as in a trial."""
    friction: Range = (0.6, 0.9)
    """Sliding friction of the pads."""

    def __post_init__(self) -> None:
        check_range(self, 0.0, "base_share", most=1.0)
        for field in fields(self)[1:]:
            least, most = getattr(self, field.name)
            if not 0.0 < least <= most < np.inf:
                raise InputError(f"{field.name} must be a range of positive numbers, got ({least}, {most})")
            if field.name in NUMBERS and most > LARGEST:
                raise InputError(f"{field.name} must be at most {LARGEST:g} m, got ({least}, {most})")
        for key, (least, most, unit) in RANGES.items():
            name = key.removeprefix("max_")
            lower, upper = getattr(self, name)
            if lower < least or upper > most:
                raise InputError(f"{name} must lie from {least:g} to {most:g}{unit}, got ({lower}, {upper})")
        if 2.0 * self.clearance[1] > self.opening[0]:
            raise InputError(f"clearance must be at most half of any opening, got {self.clearance!r}")
        for whole, tip in (("finger_width", "tip_width"), ("finger_thickness", "tip_thickness")):
            if getattr(self, whole)[1] < getattr(self, tip)[1]:
                raise InputError(f"{whole} must reach as far as {tip}, got {getattr(self, whole)!r}")
        if self.finger_length[0] < self.finger_reach[1] + PAD_MARGIN:
            raise InputError(
                f"finger_length must be {PAD_MARGIN:g} m longer than any finger_reach, got {self.finger_length!r}"
            )


def draw_hand(family: HandFamily, base: Gripper, rng: np.random.Generator) -> Gripper:
    """The hand of a scene: the base hand itself in `base_share` of the draws, else a member of the family.

    Args:
        family: the ranges.
        base: the hand that is drawn most often.
        rng: source of every draw.
    """
    if rng.uniform() < family.base_share:
        return base
    return draw_member(family, rng)


def draw_member(family: HandFamily, rng: np.random.Generator) -> Gripper:
    """A member of the family, its lengths rounded to 0.1 mm."""

    def draw(ends: Range, least: float = 0.0, most: float = np.inf) -> float:
        return float(rng.uniform(*np.clip([least, most], *ends)))

    opening, length = _rounded(draw(family.opening)), _rounded(draw(family.finger_length))
    reach, clearance = _rounded(draw(family.finger_reach)), _rounded(draw(family.clearance))
    tip_width, tip_thickness = draw(family.tip_width), draw(family.tip_thickness)
    width = draw(family.finger_width, least=tip_width, most=1.5 * tip_width)
    thickness = draw(family.finger_thickness, least=tip_thickness, most=tip_thickness + 0.03)
    pad = max(length * draw(PAD_SHARE), reach + PAD_MARGIN)
    rear = length + draw((0.0, MATING_DEPTH - 0.001))
    finger = [
        _box(tip_width, (0.0, tip_thickness), (-pad, 0.0)),
        _box(width, (STAND_BACK, thickness), (-rear, STAND_BACK - pad)),
    ]
    # A palm is about as long as its fingers need to slide, sometimes more, as the Franka hand's.
    palm_length = draw(family.palm_length, least=opening - 0.02, most=opening + 2.0 * thickness + 0.06)
    palm_width, depth = draw(family.palm_width), draw(family.palm_depth)
    has_wrist = rng.uniform() < WRIST_SHARE
    body = depth * draw(BODY_SHARE) if has_wrist else depth
    palm = [_box(palm_width, (-palm_length / 2, palm_length / 2), (-length - body, -length))]
    if has_wrist:
        across, along = draw(WRIST_SIZE) * palm_width, draw(WRIST_SIZE) * palm_length
        palm.append(_box(across, (-along / 2, along / 2), (-length - depth, -length - body)))
    return Gripper.from_dict(
        {
            "name": f"family {1e3 * opening:.0f} x {1e3 * length:.0f} mm",
            "max_opening": opening,
            "finger_reach": reach,
            "clearance": clearance,
            "finger_force": round(draw(family.finger_force), 1),
            "friction": round(draw(family.friction), 2),
            "base_offset": [0.0, 0.0, _rounded(-length - depth)],
            "palm": palm,
            "finger": finger,
        }
    )


def hand_numbers(gripper: Gripper) -> Float[np.ndarray, "k"]:
    """The few numbers of a hand [m], in the order of `NUMBERS`; those of a palm are 0 where there is none."""
    tip = [box for box in gripper.finger if box.corners()["upper"][2] > -TOUCH]
    tip_width, tip_thickness, _ = extents(tip)
    width, thickness, length = extents(gripper.finger)
    if gripper.palm:
        length = -max(box.corners()["upper"][2] for box in gripper.palm)
    palm = extents(gripper.palm) if gripper.palm else (0.0, 0.0, 0.0)
    finger = (length, tip_width, tip_thickness, width, thickness)
    return np.array([gripper.max_opening, *finger, *palm, gripper.finger_reach, gripper.clearance])


def outside(family: HandFamily, gripper: Gripper) -> list[str]:
    """Which numbers of a hand lie outside of the family's ranges, one phrase each; none if it is like its members."""
    found = [
        f"{name.replace('_', ' ')} {1e3 * value:.4g} mm, not {1e3 * least:.4g} to {1e3 * most:.4g} mm"
        for name, value in zip(NUMBERS, hand_numbers(gripper).tolist(), strict=True)
        for least, most in [getattr(family, name)]
        if not least - ROUNDING <= value <= most + ROUNDING
    ]
    least, most = family.finger_force
    if not least <= gripper.finger_force <= most:
        found.append(f"finger force {gripper.finger_force:g} N, not {least:g} to {most:g} N")
    least, most = family.friction
    if not least <= gripper.friction <= most:
        found.append(f"friction {gripper.friction:g}, not {least:g} to {most:g}")
    return found


def _rounded(length: float) -> float:
    return round(length, DIGITS)


def _box(width: float, y: Range, z: Range) -> dict[str, list[float]]:
    """A box of this width, centred at x = 0, and from the one y and z to the other [m], as in a gripper file."""
    corners = zip((-width / 2, width / 2), y, z, strict=True)
    lower, upper = ([_rounded(value) for value in corner] for corner in corners)
    return {"lower": lower, "upper": upper}

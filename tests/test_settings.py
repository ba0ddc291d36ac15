from dataclasses import dataclass
from typing import Literal

import pytest

from icgnet.errors import InputError
from icgnet.settings import check_choices, check_range


@dataclass(frozen=True)
class Oven:
    mode: Literal["grill", "air"] = "air"
    light: Literal["on", "off"] | None = None
    heat: float | None = 1.0
    name: str = "x"


@pytest.mark.parametrize("oven", [Oven(), Oven("grill", "on"), Oven("air", None)])
def test_valid_choices_pass(oven):
    check_choices(oven)


@pytest.mark.parametrize(
    ("oven", "message"),
    [
        (Oven("steam"), "mode must be one of grill, air, got 'steam'"),
        (Oven(light="dim"), "light must be one of on, off, got 'dim'"),
        (Oven(mode=None), "mode must be one of grill, air, got None"),
    ],
)
def test_another_choice_is_named_beside_the_valid_ones(oven, message):
    with pytest.raises(InputError, match=message):
        check_choices(oven)


@pytest.mark.parametrize("heat", [0.5, 2, None, 0.500001])
def test_numbers_in_range_pass(heat):
    check_range(Oven(heat=heat), 0.5, "heat", most=2.0)


@pytest.mark.parametrize("heat", [0.4, 2.1, float("nan"), float("inf"), "hot"])
def test_numbers_out_of_range_are_named(heat):
    with pytest.raises(InputError, match=r"heat must be a number at least 0\.5 and at most 2, got"):
        check_range(Oven(heat=heat), 0.5, "heat", most=2.0)


def test_a_limit_can_be_left_out_of_the_range():
    with pytest.raises(InputError, match="heat must be a number above 0, got 0"):
        check_range(Oven(heat=0), 0.0, "heat", above=True)

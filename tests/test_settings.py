import json
from dataclasses import asdict, dataclass, replace
from typing import Literal

import pytest

from icgnet.errors import InputError
from icgnet.settings import check_choices, check_range, read_settings


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
    with pytest.raises(InputError, match=r"heat must be at least 0\.5 and at most 2, got"):
        check_range(Oven(heat=heat), 0.5, "heat", most=2.0)


def test_a_limit_can_be_left_out_of_the_range():
    with pytest.raises(InputError, match="heat must be above 0, got 0"):
        check_range(Oven(heat=0), 0.0, "heat", above=True)


@dataclass(frozen=True)
class Kitchen:
    oven: Oven = Oven()
    plates: tuple[int, ...] = (1, 2)
    at: tuple[float, str] = (0.0, "wall")
    warm: bool = True


def test_settings_survive_plain_values():
    kitchen = Kitchen(Oven("grill", "on", None), (3,))
    plain = json.loads(json.dumps(asdict(kitchen)))
    plain["oven"]["heat"] = 2
    assert read_settings(Kitchen, plain) == replace(kitchen, oven=Oven("grill", "on", 2.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"plates": [1.5]}, "plates must be of type int, got 1.5"),
        ({"plates": "12"}, r"plates must be of type tuple\[int, ...\], got '12'"),
        ({"at": [1.0]}, "at must be of type"),
        ({"warm": 1}, "warm must be of type bool, got 1"),
        ({"oven": {}}, "oven: the fields differ from Oven"),
        ({"oven": asdict(Oven()) | {"mode": "steam"}}, "oven.mode must be of type"),
        ({"oven": asdict(Oven()) | {"heat": "hot"}}, "oven.heat must be of type"),
        ({"sink": 1}, r"fields differ from Kitchen: \['sink'\]"),
    ],
)
def test_a_plain_value_of_another_type_is_named(change, message):
    with pytest.raises(InputError, match=message):
        read_settings(Kitchen, asdict(Kitchen()) | change)

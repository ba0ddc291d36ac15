from pathlib import Path
from typing import Any

import numpy as np
import pytest

from icgnet.errors import InputError
from icgnet.grasping.gripper import load_gripper
from icgnet.objects.kinds import CUBE_KINDS, Kind
from icgnet.objects.object_set import load_object_set
from icgnet.studies.config import SimulationConfig
from icgnet.studies.simulation import (
    PUBLISHED,
    SimulationNumbers,
    measure_agreement,
    measure_creep,
    measure_scenes,
    measure_traces,
    tables,
)


@pytest.fixture(scope="module")
def procedural():
    return load_object_set("procedural")


@pytest.mark.parametrize("kind", ["packed", "pile"])
def test_scene_numbers_add_up_and_nothing_explodes(procedural, kind):
    numbers = measure_scenes(kind, procedural, "val", 6, seed=0)
    histogram = np.array(numbers["placed_histogram"])
    assert histogram.sum() == 6
    assert numbers["placed"] == pytest.approx((histogram * np.arange(6)).sum() / 6)
    assert numbers["placed"] + numbers["lost"] == pytest.approx(numbers["attempts"] * (1 - numbers["rejected"]))
    # A fall of 20 cm ends at 2 m/s.
    assert 0.0 < numbers["top_speed"] < 3.0
    assert measure_scenes(kind, procedural, "val", 6, seed=0) == numbers


@pytest.mark.slow
def test_the_label_filter_agrees_with_the_whole_physics(procedural):
    agreement = measure_agreement(procedural, "val", load_gripper(), trials=150, seed=0)
    assert agreement["same_collision"] >= 0.98
    assert agreement["same_success"] >= 0.98
    assert 0.0 < agreement["success"] < 1.0
    assert agreement["filtered"] > 0.5


@pytest.mark.parametrize("name", ["scenes", "trials"])
def test_counts_below_one_are_refused(name):
    zero: dict[str, Any] = {name: 0}
    with pytest.raises(InputError, match=f"{name} must be at least 1, got 0"):
        SimulationConfig(objects=Path("vgn"), **zero)


def test_reference_grasps_need_their_objects(procedural):
    with pytest.raises(InputError, match="packed/chips_can"):
        measure_traces(procedural, load_gripper())


def test_published_values_stand_beside_ours_of_the_same_kind(procedural):
    scenes: dict[Kind, dict[str, Any]] = {
        kind: measure_scenes(kind, procedural, "val", 1, seed=0) for kind in CUBE_KINDS
    }
    _, table, _ = tables(SimulationNumbers((), {}, scenes, {}))
    assert table.headers == ("scenes of five objects", "packed", "published", "pile", "published")
    rows = {label: cells for label, *cells in table.rows}
    assert rows["placed, mean"] == [
        f"{scenes['packed']['placed']:.2f}",
        "3.60",
        f"{scenes['pile']['placed']:.2f}",
        "4.48",
    ]
    assert rows["rejected share of attempts"][1::2] == ["0.67", "-"]
    assert "0.37 a scene" in table.notes[0]


@pytest.mark.slow
def test_scenes_are_like_the_published_ones(vgn_objects):
    object_set, published = load_object_set(vgn_objects), PUBLISHED["scenes"]
    packed = measure_scenes("packed", object_set, "test", 60, seed=0)
    assert packed["placed"] == pytest.approx(published["packed"]["placed"], abs=0.25)
    assert packed["rejected"] == pytest.approx(published["packed"]["rejected"], abs=0.06)
    assert packed["tilted"] < 0.08
    pile = measure_scenes("pile", object_set, "test", 60, seed=0)
    assert pile["placed"] == pytest.approx(published["pile"]["placed"] + published["pile"]["fell_through"], abs=0.25)
    assert max(packed["top_speed"], pile["top_speed"]) < 3.0


@pytest.mark.slow
def test_no_held_object_creeps(vgn_objects):
    holds = measure_creep(load_object_set(vgn_objects), "test", load_gripper())
    held = [hold for hold in holds.values() if hold.is_held]
    assert len(held) >= 30
    assert max(hold.creep for hold in held) < 0.002

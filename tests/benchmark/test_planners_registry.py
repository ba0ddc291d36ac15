"""Planners by name, the user's own included."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from icgnet.benchmark.config import ClutterConfig
from icgnet.benchmark.planners.antipodal import AntipodalPlanner
from icgnet.benchmark.planners.chance import RandomPlanner
from icgnet.benchmark.planners.oracle import OraclePlanner
from icgnet.benchmark.planners.registry import load_planner
from icgnet.errors import DataError, InputError
from icgnet.inference.grasp_search import GraspSearch

OWN = """
class Mine:
    needs_truth = False

    def plan(self, observation):
        return None


class NoPlan:
    needs_truth = False


class NoAnswer:
    def plan(self, observation):
        return None


class WithArguments(Mine):
    def __init__(self, size):
        self.size = size


an_object = 3
"""


@pytest.fixture
def own_module(tmp_path, monkeypatch) -> Iterator[str]:
    """Name of a module in the current directory."""
    (tmp_path / "mine_to_test.py").write_text(OWN)
    (tmp_path / "broken_to_test.py").write_text("def plan(:")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield "mine_to_test"
    sys.modules.pop("mine_to_test", None)


def test_built_in_planners_are_known_by_name():
    kinds = {"antipodal": AntipodalPlanner, "random": RandomPlanner, "oracle": OraclePlanner}
    for name, kind in kinds.items():
        assert isinstance(load_planner(ClutterConfig(planner=name)), kind)


def test_a_class_in_the_current_directory_is_found(own_module):
    assert type(load_planner(ClutterConfig(planner=f"{own_module}:Mine"))).__name__ == "Mine"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("clairvoyant", "one of icgnet, antipodal, random, oracle, or module:Class of your own, got 'clairvoyant'"),
        ("no_such_module:Mine", "cannot import 'no_such_module' from .*No module named"),
        ("broken_to_test:Mine", "cannot import 'broken_to_test'.*invalid syntax"),
        (":Mine", "cannot import ''"),
        ("mine_to_test:Yours", "module 'mine_to_test' has no 'Yours'"),
        ("mine_to_test:", "has no ''"),
        ("mine_to_test:an_object", "must be a class with a method plan"),
        ("mine_to_test:NoPlan", "must be a class with a method plan"),
        ("mine_to_test:NoAnswer", "must say needs_truth"),
        ("mine_to_test:WithArguments", "must be made without arguments"),
    ],
)
def test_what_is_wrong_with_a_planner_is_said(own_module, name, message):
    with pytest.raises(InputError, match=message):
        load_planner(ClutterConfig(planner=name))


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"weights": Path("w.safetensors")}, "weights"),
        ({"threads": 2}, "threads"),
        ({"search": GraspSearch(most=3)}, "search"),
        ({"level_table": False}, "level_table"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_only_the_network_has_is_refused_for_other_planners(change, name):
    with pytest.raises(InputError, match=f"only the planner icgnet takes {name}, not 'oracle'"):
        ClutterConfig(planner="oracle", **change)


def test_an_opening_of_the_search_is_refused_as_the_benchmark_has_its_own():
    with pytest.raises(InputError, match=r"search\.opening has no effect here: give opening 'full' instead"):
        ClutterConfig(search=GraspSearch(opening="full"))


def test_weights_that_are_not_there_are_named(tmp_path):
    with pytest.raises(DataError, match="nowhere"):
        load_planner(ClutterConfig(weights=tmp_path / "nowhere.safetensors"))

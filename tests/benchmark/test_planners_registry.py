"""Planners by name, the user's own included."""

import sys
from collections.abc import Iterator

import pytest

from icgnet.benchmark.planners.antipodal import AntipodalPlanner
from icgnet.benchmark.planners.chance import RandomPlanner
from icgnet.benchmark.planners.oracle import OraclePlanner
from icgnet.benchmark.planners.registry import PlannerSource, load_planner
from icgnet.errors import DataError, InputError

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
        assert isinstance(load_planner(PlannerSource(name)), kind)


def test_a_class_in_the_current_directory_is_found(own_module):
    assert type(load_planner(PlannerSource(f"{own_module}:Mine"))).__name__ == "Mine"


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
        load_planner(PlannerSource(name))


def test_weights_belong_to_the_network(tmp_path):
    with pytest.raises(InputError, match="only the planner icgnet takes weights, not 'oracle'"):
        load_planner(PlannerSource("oracle", tmp_path / "w.safetensors"))
    with pytest.raises(DataError, match="nowhere"):
        load_planner(PlannerSource("icgnet", tmp_path / "nowhere.safetensors"))

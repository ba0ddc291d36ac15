"""Planners by name: the built-in ones, or a class of the user's own."""

import importlib
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from icgnet.benchmark.planner import Planner
from icgnet.errors import InputError
from icgnet.inference.grasp_search import BEST_FEW, GraspSearch


@dataclass(frozen=True)
class PlannerSource:
    """Which planner to make, and with what.

    Attributes:
        name: a built-in one (icgnet, antipodal, random, oracle), or module:Class of your own.
        weights: of the network, for icgnet; the shipped ones if None.
        threads: CPU threads of the network, for icgnet.
        search: how icgnet looks for grasps.
        level_table: whether icgnet takes out a wrong depth scale that the table's height tells.
    """

    name: str = "icgnet"
    weights: Path | None = None
    threads: int = 1
    search: GraspSearch = BEST_FEW
    level_table: bool = True


def load_planner(source: PlannerSource) -> Planner:
    """The planner that a source names.

    Raises:
        InputError: no such planner; a module or class that is missing, cannot be made or is no planner; weights for a
            planner that has none.
        DataError: the weights cannot be used.
    """
    if source.weights is not None and source.name != "icgnet":
        raise InputError(f"only the planner icgnet takes weights, not {source.name!r}")
    if source.name in BUILT_IN:
        return BUILT_IN[source.name](source)
    if ":" in source.name:
        return _load_own(source.name)
    raise InputError(f"planner must be one of {', '.join(BUILT_IN)}, or module:Class of your own, got {source.name!r}")


# Each planner brings its own packages: the network's, or the physics engine.


def _icgnet(source: PlannerSource) -> Planner:
    from icgnet.benchmark.planners.icgnet import IcgNetPlanner

    return IcgNetPlanner(source.weights, source.threads, source.search, source.level_table)


def _antipodal(_: PlannerSource) -> Planner:
    from icgnet.benchmark.planners.antipodal import AntipodalPlanner

    return AntipodalPlanner()


def _random(_: PlannerSource) -> Planner:
    from icgnet.benchmark.planners.chance import RandomPlanner

    return RandomPlanner()


def _oracle(_: PlannerSource) -> Planner:
    from icgnet.benchmark.planners.oracle import OraclePlanner

    return OraclePlanner()


BUILT_IN: dict[str, Callable[[PlannerSource], Planner]] = {
    "icgnet": _icgnet,
    "antipodal": _antipodal,
    "random": _random,
    "oracle": _oracle,
}


def _load_own(name: str) -> Planner:
    """An object of the user's class; modules in the current directory are found, as by `python` itself."""
    module_name, _, class_name = name.partition(":")
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))
    try:
        module = importlib.import_module(module_name)
    except (ImportError, SyntaxError, ValueError) as error:
        raise InputError(f"planner {name!r}: cannot import {module_name!r} from {Path.cwd()}: {error}") from error
    own: Any = getattr(module, class_name, None)
    if own is None:
        raise InputError(f"planner {name!r}: module {module_name!r} has no {class_name!r}")
    if not isinstance(own, type) or not callable(getattr(own, "plan", None)):
        raise InputError(f"planner {name!r}: {class_name!r} must be a class with a method plan(observation)")
    try:
        planner = own()
    except TypeError as error:
        raise InputError(f"planner {name!r}: {class_name!r} must be made without arguments: {error}") from error
    if not isinstance(getattr(planner, "needs_truth", None), bool):
        raise InputError(f"planner {name!r}: {class_name!r} must say needs_truth = False (or True)")
    return planner

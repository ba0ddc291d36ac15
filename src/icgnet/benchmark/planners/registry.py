"""Planners by name: the built-in ones, or a class of the user's own."""

import importlib
import sys
from pathlib import Path
from typing import Any

from icgnet.benchmark.config import OUR_NETWORK, PlannerConfig
from icgnet.benchmark.planner import Planner
from icgnet.errors import InputError


def load_planner(config: PlannerConfig) -> Planner:
    """The planner that a benchmark names.

    Raises:
        InputError: no such planner; a module or class that is missing, cannot be made or is no planner; a hand that
            the network does not know.
        DataError: the weights cannot be used.
    """
    if config.planner in BUILT_IN:
        module_name, _, class_name = BUILT_IN[config.planner].partition(":")
        built_in = getattr(importlib.import_module(f"icgnet.benchmark.planners.{module_name}"), class_name)
        return built_in(config) if config.planner == OUR_NETWORK else built_in()
    if ":" in config.planner:
        return _load_own(config.planner)
    raise InputError(
        f"planner must be one of {', '.join(BUILT_IN)}, or module:Class of your own, got {config.planner!r}"
    )


BUILT_IN = {
    OUR_NETWORK: "icgnet:IcgNetPlanner",
    "antipodal": "antipodal:AntipodalPlanner",
    "random": "chance:RandomPlanner",
    "oracle": "oracle:OraclePlanner",
}
"""Module and class of each; a planner brings its own packages, the network's or the physics engine, when it is made."""


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

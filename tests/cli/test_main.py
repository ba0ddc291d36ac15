"""The command itself: help, versions and exit codes."""

import subprocess
import sys
from typing import get_args

import pytest

from icgnet import __version__
from icgnet.cli.main import Command, main

HEAVY = ("torch", "mujoco", "scipy", "trimesh", "pyarrow", "lightning_fabric", "viser", "matplotlib", "embreex")


@pytest.mark.parametrize("arguments", [["--help"], ["predict", "--help"]])
def test_help_imports_nothing_heavy(arguments):
    code = (
        "import sys; from icgnet.cli.main import main; "
        f"code = main({arguments!r}); "
        f"heavy = [name for name in {HEAVY!r} if name in sys.modules]; "
        "sys.exit(repr(heavy) if heavy or code else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert "usage: icgnet" in done.stdout


@pytest.mark.parametrize("arguments", [["version"], ["--version"]])
def test_the_version_is_printed(arguments, capsys):
    assert main(arguments) == 0
    assert capsys.readouterr().out == f"icgnet {__version__}\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ["fly"],
        ["predict"],
        ["predict", "depth.png", "--colour", "red"],
        ["predict", "depth.png", "--depth-scale", "many"],
        ["predict", "depth.png", "--width-from", "guess"],
        ["train", "huge", "--data", "a", "--out", "b"],
        ["generate", "out", "--scene", "heap"],
    ],
    ids=" ".join,
)
def test_wrong_arguments_exit_with_2(arguments, capsys):
    assert main(arguments) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_every_subcommand_has_help(capsys):
    names = [get_args(command)[1].name for command in get_args(Command)]
    assert {"demo", "predict", "benchmark"} < set(names)
    for name in names:
        assert main([name, "--help"]) == 0
        assert f"usage: icgnet {name}" in capsys.readouterr().out


def test_presets_of_training_are_those_that_the_command_offers():
    from typing import get_args, get_type_hints

    from icgnet.cli.train import Train
    from icgnet.training.config import TRAININGS

    assert set(get_args(get_type_hints(Train)["preset"])) == set(TRAININGS)

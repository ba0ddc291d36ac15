"""The command itself: help, versions and exit codes."""

import subprocess
import sys
from pathlib import Path

import pytest

from icgnet import __version__
from icgnet.cli.main import COMMANDS, load_command, main

HEAVY = ("torch", "mujoco", "scipy", "trimesh", "pyarrow", "lightning_fabric", "viser", "matplotlib", "embreex")


def test_no_commands_help_imports_anything_heavy():
    code = (
        "import sys; from icgnet.cli.main import COMMANDS, main\n"
        "for name in ('', *COMMANDS): assert main([*name.split(), '--help']) == 0\n"
        f"heavy = [name for name in {HEAVY!r} if name in sys.modules]\n"
        "sys.exit(repr(heavy) if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr


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
        ["generate", "--out", "out", "--scene", "heap"],
    ],
    ids=" ".join,
)
def test_wrong_arguments_exit_with_2(arguments, capsys):
    assert main(arguments) == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("name", COMMANDS)
def test_every_subcommand_has_help(name, capsys):
    assert main([*name.split(), "--help"]) == 0
    assert f"usage: icgnet {name}" in capsys.readouterr().out


@pytest.mark.parametrize("name", COMMANDS)
def test_the_overview_says_what_a_subcommand_does(name, capsys):
    assert main(["--help"]) == 0
    about, doc = COMMANDS[name][1].removesuffix("."), load_command(name).__doc__ or ""
    assert f"{name} " in capsys.readouterr().out
    # The beginning of a docstring, up to a mark.
    assert doc.startswith(about)
    assert not doc[len(about)].isalpha()


@pytest.mark.parametrize(
    ("arguments", "valid"), [(["fly"], "demo, predict"), (["dataset", "fly"], "dataset inspect")], ids=" ".join
)
def test_an_unknown_command_is_one_line_with_the_valid_ones(arguments, valid, capsys):
    assert main(arguments) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"error: no command {' '.join(arguments)!r}; the commands are {valid}")
    assert err.count("\n") == 1


def test_a_group_of_commands_lists_itself(capsys):
    assert main(["dataset"]) == main(["dataset", "--help"]) == 0
    assert "dataset inspect" in capsys.readouterr().out


def test_presets_of_training_are_those_that_the_command_offers():
    from icgnet.training.config import TRAININGS

    assert {f"train {name}" for name in TRAININGS} == {name for name in COMMANDS if name.startswith("train ")}
    assert all(load_command(f"train {name}")((), Path(".")).config == config for name, config in TRAININGS.items())


def test_every_setting_of_training_can_be_set_and_shows_the_default_of_its_preset(capsys):
    assert main(["train", "paper", "--help"]) == 0
    out = "".join(capsys.readouterr().out.split())
    for option in (
        "--batchINT",
        "--sampling.tsdfFLOAT",
        "--loss.maskFLOAT",
        "--matching.diceFLOAT",
        "--sampling.noise",
    ):
        assert option in out
    assert "(default:101250)" in out


def test_the_completion_of_a_shell_knows_the_commands(capsys):
    assert main(["--tyro-print-completion", "bash"]) == 0
    assert "dataset-inspect" in capsys.readouterr().out
    assert main(["dataset-inspect", "--help"]) == 0

"""`icgnet ros2`: what is wrong is one line, and the help needs no DDS."""

import builtins
import sys

import pytest

from icgnet.cli.main import main


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--image", "no topic"], "image must be a name of letters, digits, _ and / such as /camera/depth, got"),
        (["--domain", "300"], "domain must be at least 0 and at most 232, got 300"),
        (["--threads", "0"], "threads must be at least 1"),
    ],
)
def test_what_is_wrong_is_one_line(arguments, said, capsys):
    assert main(["ros2", *arguments]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_without_the_extra_it_says_what_to_install(capsys, monkeypatch):
    real = builtins.__import__

    def without(name, *arguments, **named):
        if name.startswith("icgnet.ros2.node"):
            name = "icgnet.ros2.dds"
        if name.startswith("cyclonedds"):
            raise ModuleNotFoundError("No module named 'cyclonedds'", name="cyclonedds")
        return real(name, *arguments, **named)

    monkeypatch.delitem(sys.modules, "icgnet.ros2.dds", raising=False)
    monkeypatch.setattr(builtins, "__import__", without)
    assert main(["ros2"]) == 2
    said = 'error: icgnet ros2 needs the package cyclonedds, which is not installed: pip install "icgnet[ros2]"\n'
    assert capsys.readouterr().err == said

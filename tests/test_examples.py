"""The examples run as they are."""

import runpy
import sys
from pathlib import Path

import pytest

from icgnet.cli.demo import CAPTURE
from icgnet.predictor import DEFAULT_WEIGHTS

EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("0[1-4]_*.py")), ids=lambda path: path.stem)
def test_example_runs(path, capsys, monkeypatch):
    if not (CAPTURE.is_file() and DEFAULT_WEIGHTS.is_file()):
        pytest.skip("needs the shipped weights and the demo capture")
    monkeypatch.setattr(sys, "argv", [str(path)])
    runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out

import json

import numpy as np
import pytest
from PIL import Image

from icgnet.cli.main import main
from icgnet.errors import DataError, InputError
from icgnet.viewer.training_curves import PANELS, SMOOTHED, curves_figure, draw_curves, read_run


@pytest.fixture
def run(tmp_path):
    """A run of 40 logged minutes whose loss falls and that is validated twice."""
    lines = [{"kind": "train", "scenes": 100 * k, "elapsed_s": 60.0 * k, "loss": 40.0 - k} for k in range(40)]
    for k, iou in ((39, 0.75), (20, 0.5)):
        lines.insert(k + 1, {"kind": "val", "scenes": 100 * k, "elapsed_s": 60.0 * k, "occupancy_scene_iou": iou})
    folder = tmp_path / "first"
    folder.mkdir()
    (folder / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return folder


def test_validation_stands_where_it_was_made(run):
    panel = [name for _, name, _ in PANELS].index("occupancy_scene_iou")
    for over, unit in (("visits", 100), ("minutes", 1)):
        (line,) = curves_figure([read_run(run)], over).axes[panel].lines
        np.testing.assert_allclose(line.get_xydata(), [[20 * unit, 0.5], [39 * unit, 0.75]])
        assert line.get_label() == "first"


def test_the_loss_is_a_running_mean(run):
    (line,) = curves_figure([read_run(run)], "minutes").axes[0].lines
    x, y = line.get_xydata().T
    assert len(x) == 40 - SMOOTHED + 1
    np.testing.assert_allclose(y, 40.0 - x)


def test_runs_share_a_picture_and_a_log_file_is_a_run(run, tmp_path):
    other = tmp_path / "second.jsonl"
    other.write_text((run / "metrics.jsonl").read_text())
    runs = [read_run(run), read_run(other)]
    assert [line.get_label() for line in curves_figure(runs).axes[0].lines] == ["first", "second"]
    draw_curves(runs, tmp_path / "folder" / "curves.png")
    with Image.open(tmp_path / "folder" / "curves.png") as image:
        assert image.size[0] > image.size[1] > 300


def test_what_a_resumed_run_did_again_is_drawn_once(run):
    file = run / "metrics.jsonl"
    again = [{"kind": "train", "scenes": 100 * k, "elapsed_s": 60.0 * k, "loss": 1.0} for k in (30, 31)]
    file.write_text(file.read_text() + "".join(json.dumps(line) + "\n" for line in again))
    places, losses = read_run(file).values("train", "loss", "minutes")
    np.testing.assert_array_equal(places, np.arange(32))
    assert list(losses[-3:]) == [11.0, 1.0, 1.0]
    assert read_run(file).name == "first"


def test_what_is_no_log_is_named(run, tmp_path):
    (tmp_path / "broken.jsonl").write_text('{"kind": "tr')
    (tmp_path / "other.jsonl").write_text('{"a": 1}\n')
    (tmp_path / "words.jsonl").write_text('{"kind": "train", "scenes": 1, "elapsed_s": 1, "loss": "x"}\n')
    (tmp_path / "empty.jsonl").write_text("")
    for name in ("broken.jsonl", "other.jsonl", "words.jsonl", "empty.jsonl", "absent.jsonl"):
        with pytest.raises(DataError, match=name):
            read_run(tmp_path / name)
    with pytest.raises(InputError, match="no runs"):
        curves_figure([])


def test_the_command_draws_and_refuses_in_one_line(run, tmp_path, capsys):
    assert main(["curves", str(run), "--out", str(tmp_path / "c.png"), "--over", "minutes"]) == 0
    assert (tmp_path / "c.png").is_file()
    assert main(["curves", str(run), "--out", str(tmp_path / "c.pdf")]) == 2
    assert main(["curves", str(tmp_path / "nowhere"), "--out", str(tmp_path / "d.png")]) == 2
    assert "nowhere" in capsys.readouterr().err

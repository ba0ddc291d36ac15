"""`icgnet generate` and `icgnet train`, and what they say of broken data."""

import json
from pathlib import Path

import pytest

from icgnet.cli.main import main
from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.network.weights import save_weights
from launch import icgnet_together, output_of


@pytest.fixture(scope="module")
def scenes(tmp_path_factory) -> Path:
    """Two small labelled scenes of procedural objects."""
    folder = tmp_path_factory.mktemp("data") / "scenes"
    options = ["--scene", "packed", "--scenes", "2", "--labels.contacts", "4"]
    assert main(["generate", "--out", str(folder), *options]) == 0
    return folder


@pytest.mark.slow
def test_generate_writes_scenes_and_a_report(scenes):
    assert json.loads((scenes / "report.json").read_text())["scenes"] == 2
    assert list(scenes.glob("*.parquet"))


@pytest.mark.slow
def test_generate_again_finds_everything_done(scenes, capsys):
    assert main(["generate", "--out", str(scenes), "--scene", "packed", "--scenes", "2", "--labels.contacts", "4"]) == 0
    out = capsys.readouterr().out
    assert "0 new scenes, 2 were there already" in out
    assert "2/2" in out


@pytest.mark.slow
@pytest.mark.parametrize(("options", "network"), [([], "tiny"), (["--network", "paper"], "paper")])
def test_train_writes_weights_that_predict_can_load(scenes, tmp_path, options, network):
    from icgnet.predictor import Predictor

    arguments = ["train", "tiny", *options, "--data", str(scenes), "--out", str(tmp_path / "run"), "--steps", "1"]
    assert main(arguments) == 0
    (weights,) = (tmp_path / "run").glob("weights_final.safetensors")
    assert Predictor.load(weights).network.config.name == network


@pytest.mark.slow
def test_processes_of_torchrun_train_one_network(scenes, tmp_path):
    first, run = tmp_path / "first.safetensors", tmp_path / "run"
    save_weights(first, IcgNet(NETWORKS["tiny"]), {})
    command = ["train", "tiny", "--accelerator", "cpu", "--data", scenes, "--steps", 1]
    options = ["--learning-rate", "2e-3", "--no-common-statistics", "--start", first]
    output_of(icgnet_together(*command, *options, "--out", run))
    config = json.loads((run / "config.json").read_text())
    assert config["scenes_per_step"] == 2 * config["training"]["batch"]
    assert config["training"]["learning_rate"] == 2e-3
    assert config["training"]["common_statistics"] is False
    assert config["data"]["start"]
    assert (run / "weights_final.safetensors").is_file()


@pytest.mark.slow
def test_truncated_parquet_is_one_line_that_names_the_file(scenes, tmp_path, capsys):
    broken = tmp_path / "scenes"
    broken.mkdir()
    for path in scenes.iterdir():
        content = path.read_bytes()
        (broken / path.name).write_bytes(content[: len(content) // 2] if path.suffix == ".parquet" else content)
    assert main(["train", "tiny", "--data", str(broken), "--out", str(tmp_path / "run")]) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert ".parquet" in err
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["train", "tiny", "--data", "nowhere", "--out", "run"], "nowhere"),
        (["train", "tiny", "--data", "a", "--out", "run", "--minutes", "1", "--steps", "2"], "either steps or minutes"),
        (["generate", "--out", "out", "--objects", "nowhere"], "nowhere"),
        (["generate", "--out", "out", "--scenes", "0"], "scenes must be at least 1, got 0"),
        (["generate", "--out", "out", "--labels.contacts", "0"], "contacts must be at least 1, got 0"),
        (["generate", "--out", "out", "--shard-scenes", "0"], "shard_scenes must be at least 1, got 0"),
        (["generate", "--out", "out", "--ray", "nowhere"], "host:port"),
        (["objects", "check", "nowhere"], "nowhere"),
        (["view", "nowhere"], "nowhere"),
    ],
)
def test_wrong_use_is_one_line_and_leaves_nothing(arguments, named, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ")
    assert named in err
    assert list(tmp_path.iterdir()) == []

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save, save_file

from icgnet.errors import DataError
from icgnet.network import weights_header
from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.network.weights import load_weights, save_weights, tensors_checksum
from icgnet.network.weights_header import WeightsHeader, read_header, stored_checksum
from icgnet.predictor import DEFAULT_WEIGHTS


@pytest.fixture
def network() -> IcgNet:
    torch.manual_seed(0)
    return IcgNet(NETWORKS["tiny"])


def test_weights_survive_the_file(network, tmp_path):
    save_weights(tmp_path / "net.safetensors", network, {"epoch": 3, "note": "x"})
    loaded, metadata = load_weights(tmp_path / "net.safetensors", NETWORKS["tiny"])
    assert metadata == {"epoch": 3, "note": "x"}
    assert loaded.config == network.config
    assert not loaded.training
    for name, tensor in network.state_dict().items():
        assert torch.equal(loaded.state_dict()[name], tensor), name


def test_half_precision_halves_the_file_and_keeps_the_weights_close(network, tmp_path):
    full, half = tmp_path / "full.safetensors", tmp_path / "half.safetensors"
    save_weights(full, network, {})
    save_weights(half, network, {}, half=True)
    loaded, _ = load_weights(half)
    assert half.stat().st_size < 0.65 * full.stat().st_size
    for name, tensor in network.state_dict().items():
        assert loaded.state_dict()[name].dtype == tensor.dtype
        torch.testing.assert_close(loaded.state_dict()[name], tensor, rtol=1e-3, atol=1e-6)


def test_weights_of_another_configuration_are_a_data_error(network, tmp_path):
    save_weights(tmp_path / "net.safetensors", network, {})
    with pytest.raises(DataError, match="queries is 8, wanted 9"):
        load_weights(tmp_path / "net.safetensors", replace(NETWORKS["tiny"], queries=9))


def test_missing_foreign_and_damaged_files_are_data_errors(network, tmp_path):
    path = tmp_path / "net.safetensors"
    with pytest.raises(DataError, match="no such"):
        load_weights(path)
    path.write_bytes(b"not a weights file at all")
    with pytest.raises(DataError, match="safetensors"):
        load_weights(path)
    save_file({"weight": torch.zeros(3)}, path)
    with pytest.raises(DataError, match="not icgnet weights"):
        load_weights(path)
    save_weights(path, network, {})
    content = bytearray(path.read_bytes())
    path.write_bytes(content[:-100])
    with pytest.raises(DataError, match="safetensors"):
        load_weights(path)
    content[-1] ^= 1
    path.write_bytes(content)
    with pytest.raises(DataError, match="checksum"):
        load_weights(path)


def test_file_is_plain_safetensors(network, tmp_path):
    save_weights(tmp_path / "net.safetensors", network, {})
    assert set(load_file(tmp_path / "net.safetensors")) == set(network.state_dict())


def forge(path: Path, config: Any, metadata: Any = None, tensors: dict[str, torch.Tensor] | None = None) -> Path:
    """Writes weights of any configuration, with checksums that are right."""
    tensors = tensors or {"weight": torch.zeros(3)}
    entries = WeightsHeader(NETWORKS["tiny"], {}, tensors_checksum(tensors)).entries()
    del entries["header_sha256"]
    entries |= {"config": config if isinstance(config, str) else json.dumps(config), "metadata": json.dumps(metadata)}
    entries["header_sha256"] = weights_header._checksum(entries)
    path.write_bytes(save(tensors, entries))
    return path


def test_the_shipped_weights_are_of_the_default_preset_and_know_all_classes():
    header = read_header(DEFAULT_WEIGHTS)
    assert header.config == NETWORKS["default"]
    assert header.config.gripper.name == "franka"


def test_weights_of_the_first_version_are_refused_with_what_to_do(tmp_path):
    save_file({"weight": torch.zeros(3)}, tmp_path / "old.safetensors", {"format": "icgnet-weights-1"})
    message = r"old\.safetensors: weights of an earlier .* which hand and classes .*: train again"
    for read in (load_weights, stored_checksum):
        with pytest.raises(DataError, match=message):
            read(tmp_path / "old.safetensors")


def test_the_checksum_covers_the_header(network, tmp_path):
    path = tmp_path / "net.safetensors"
    save_weights(path, network, {"step": 1})
    content = path.read_bytes()
    path.write_bytes(content.replace(b'voxel_size\\": 0.003', b'voxel_size\\": 0.004'))
    assert path.read_bytes() != content
    with pytest.raises(DataError, match="the checksum of the header does not match"):
        load_weights(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"voxel_size": 0}, "voxel_size must be at least 0.001 and at most 0.05, got 0"),
        ({"voxel_size": -1.0}, "voxel_size must be"),
        ({"voxel_size": "a"}, "voxel_size must be of type float, got 'a'"),
        ({"voxel_size": 10**400}, "voxel_size must be of type float, got 1000"),
        ({"voxel_size": float("nan")}, "voxel_size must be of type float, got nan"),
        ({"queries": True}, "queries must be of type int, got True"),
        ({"queries": 8.5}, "queries must be of type int, got 8.5"),
        ({"heads": 0}, "heads must be at least 1"),
        ({"dilations": [0] * 8}, "dilations must be 1 to 16 numbers from 1 to 64"),
        ({"dilations": 3}, r"dilations must be of type tuple\[int, ...\], got 3"),
        ({"dilations": [[1]] * 8}, r"dilations must be of type int, got \[1\]"),
        ({"tokens_per_level": []}, "tokens_per_level must be 1 to 16 numbers"),
        ({"affordance": "hands"}, "affordance must be of type .*'contact', 'hand'"),
        ({"affordance": ["hand"]}, "affordance must be of type"),
        ({"visibility": None}, "visibility must be of type bool, got None"),
        ({"hand": []}, "hand: the fields differ from HandConfig: list"),
        ({"hand": {"rays": 1}}, "hand: the fields differ from HandConfig"),
        ({"classes": 7}, r"classes must be of type tuple\[str, ...\], got 7"),
        ({"classes": ["box", "box"]}, "classes must have different names"),
        ({"classes": ["../box"]}, "a class must have a name of 1 to 40 letters"),
        ({"gripper": None}, "must have the entries"),
        ({"colour": 1}, r"settings: the fields differ from NetworkConfig: \['colour'\]"),
    ],
)
def test_any_wrong_field_of_the_configuration_is_one_line(tmp_path, change, message):
    config = json.loads(json.dumps(NETWORKS["tiny"].to_dict())) | change
    path = forge(tmp_path / "net.safetensors", config, {})
    with pytest.raises(DataError, match=rf"net\.safetensors: its configuration is not .*{message}") as error:
        load_weights(path)
    assert len(str(error.value)) < 700


@pytest.mark.parametrize("config", ["[]", "null", "3", "{", "[" * 100_000, '{"hand": 3}', "{}"])
def test_a_configuration_that_is_none_is_a_data_error(tmp_path, config):
    with pytest.raises(DataError, match="its configuration is not of this version") as error:
        load_weights(forge(tmp_path / "net.safetensors", config, {}))
    assert len(str(error.value)) < 700


def test_metadata_and_tensors_of_another_kind_are_data_errors(network, tmp_path):
    path = tmp_path / "net.safetensors"
    config = network.config.to_dict()
    with pytest.raises(DataError, match=r"its metadata are not a mapping but '\[3\]'"):
        load_weights(forge(path, config, [3]))
    with pytest.raises(DataError, match="tensors are missing, unknown or of another shape"):
        load_weights(forge(path, config, {}))
    for wrong in (float("nan"), float("inf")):
        tensors = {name: tensor.clone() for name, tensor in network.state_dict().items()}
        tensors[next(iter(tensors))].view(-1)[0] = wrong
        with pytest.raises(DataError, match="1 tensors hold numbers that are not finite"):
            load_weights(forge(path, config, {}, tensors))

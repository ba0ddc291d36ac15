from dataclasses import replace

import pytest
import torch
from safetensors.torch import load_file, save_file

from icgnet.errors import DataError
from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.network.weights import load_weights, save_weights


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

"""Weights in one safetensors file that names its own configuration and is checked when read."""

import hashlib
from collections.abc import Collection
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from icgnet.errors import DataError
from icgnet.files import new_file
from icgnet.network.config import NetworkConfig
from icgnet.network.icgnet import IcgNet
from icgnet.network.weights_header import WeightsHeader, read_header


def save_weights(
    path: Path | str,
    network: IcgNet,
    metadata: dict[str, Any],
    half: bool = False,
    full: Collection[str] = (),
) -> None:
    """Write a network's weights and its configuration, which names hand and classes, atomically.

    Args:
        path: file to write.
        network: network on any device.
        metadata: plain values about the training (JSON), given back by `load_weights`.
        half: store kernels in 16 bits (IEEE half); vectors and statistics stay in 32.
        full: names of kernels that stay in 32 bits all the same.
    """
    path = Path(path)
    tensors = {}
    for name, tensor in network.state_dict().items():
        stored = tensor.detach().cpu().contiguous()
        shortened = half and name not in full and stored.is_floating_point() and stored.ndim > 1
        tensors[name] = stored.half() if shortened else stored
    header = WeightsHeader(network.config, metadata, tensors_checksum(tensors))
    with new_file(path) as file:
        file.write(save(tensors, header.entries()))


def load_weights(path: Path | str, config: NetworkConfig | None = None) -> tuple[IcgNet, dict[str, Any]]:
    """The network of a weights file, in evaluation mode, and the metadata that were saved with it.

    Args:
        path: file that `save_weights` wrote.
        config: the configuration that the file must have; None takes the file's.

    Raises:
        DataError: for a missing, damaged or foreign file, or one of another configuration.
    """
    path = Path(path)
    header = read_header(path)
    if config is not None:
        header.check_config(config, path)
    try:
        with safe_open(path, framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
    except (SafetensorError, OSError) as error:
        raise DataError(f"{path}: not a readable safetensors file ({error})") from error
    if header.sha256 != tensors_checksum(tensors):
        raise DataError(f"{path}: damaged, the checksum of the weights does not match")
    network = IcgNet(header.config)
    _fill(network, tensors, path)
    return network.eval(), header.metadata


def is_stored_in_half(path: Path | str) -> bool:
    """Whether a weights file holds kernels in 16 bits.

    Raises:
        DataError: for a missing, damaged or foreign file.
    """
    try:
        with safe_open(Path(path), framework="pt") as file:
            return any(file.get_slice(name).get_dtype() == "F16" for name in file.keys())  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise DataError(f"{path}: not icgnet weights ({type(error).__name__} {error})") from error


def _fill(network: IcgNet, tensors: dict[str, Tensor], path: Path) -> None:
    expected = network.state_dict()
    wrong = sorted(set(tensors) ^ set(expected))
    wrong += [name for name in set(tensors) & set(expected) if tensors[name].shape != expected[name].shape]
    if wrong:
        raise DataError(f"{path}: {len(wrong)} tensors are missing, unknown or of another shape, e.g. {wrong[0]}")
    converted = {name: tensor.to(expected[name].dtype) for name, tensor in tensors.items()}
    broken = [name for name in sorted(converted) if not bool(torch.isfinite(converted[name]).all())]
    if broken:
        raise DataError(f"{path}: {len(broken)} tensors hold numbers that are not finite, e.g. {broken[0]}")
    network.load_state_dict(converted)


def tensors_checksum(tensors: dict[str, Tensor]) -> str:
    """SHA-256 over names and contents of tensors on the CPU, in the order of their names."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        digest.update(name.encode())
        digest.update(tensors[name].contiguous().reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()

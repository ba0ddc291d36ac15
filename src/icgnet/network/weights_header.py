"""What a weights file says of itself: read without torch and without its tensors, and checked."""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open

from icgnet.errors import DataError
from icgnet.grasping.gripper import load_gripper
from icgnet.network.config import NetworkConfig
from icgnet.objects.classes import class_index

DEFAULT_WEIGHTS = Path(__file__).parents[1] / "weights" / "default.safetensors"
FORMAT = "icgnet-weights-2"
"""Since 2, the configuration names the hand and the classes."""


@dataclass(frozen=True)
class WeightsHeader:
    """The header of a weights file.

    Attributes:
        config: of the network, with the hand and the classes that it knows.
        metadata: plain values about the training.
        sha256: of the tensors; see `icgnet.network.weights.tensors_checksum`.
    """

    config: NetworkConfig
    metadata: dict[str, Any]
    sha256: str

    def check_config(self, wanted: NetworkConfig, path: Path | str) -> None:
        """Makes sure that the network is one of a configuration; hands that make the same labels are the same.

        Raises:
            DataError: it is not; the message says in what they differ.
        """
        differences = wanted.differences(self.config)
        if differences:
            raise DataError(f"{path}: weights of another configuration: {', '.join(differences)}")

    def entries(self) -> dict[str, str]:
        """The entries of the safetensors file's metadata, with their own checksum."""
        entries = {
            "format": FORMAT,
            "config": json.dumps(self.config.to_dict(), sort_keys=True),
            "metadata": json.dumps(self.metadata, sort_keys=True),
            "sha256": self.sha256,
        }
        return entries | {"header_sha256": _checksum(entries)}


def read_header(path: Path | str) -> WeightsHeader:
    """The header of a weights file; whether its tensors are whole is not looked at.

    Raises:
        DataError: for a missing, damaged or foreign file, or one of another version.
    """
    path = Path(path)
    if not path.is_file():
        raise DataError(f"{path}: no such weights file")
    try:
        with safe_open(path, framework="np") as file:
            entries = dict(file.metadata() or {})
    except (SafetensorError, OSError) as error:
        raise DataError(f"{path}: not a readable safetensors file ({error})") from error
    found = entries.get("format", "")
    if found == "icgnet-weights-1":
        raise DataError(
            f"{path}: weights of an earlier version ({found!r}, expected {FORMAT!r}) do not say which hand and classes "
            "they know: train again, or take the weights that ship with this version"
        )
    if found != FORMAT:
        raise DataError(f"{path}: not icgnet weights (format {found[:80]!r}, expected {FORMAT!r})")
    if entries.pop("header_sha256", None) != _checksum(entries):
        raise DataError(f"{path}: damaged, the checksum of the header does not match")
    try:
        config = NetworkConfig.from_dict(json.loads(entries["config"]))
        metadata = json.loads(entries["metadata"])
    except (KeyError, ValueError, RecursionError) as error:  # an InputError is a ValueError, too
        raise DataError(f"{path}: its configuration is not of this version of icgnet ({error})") from error
    if not isinstance(metadata, dict):
        raise DataError(f"{path}: its metadata are not a mapping but {str(metadata)[:80]!r}")
    return WeightsHeader(config, metadata, entries.get("sha256", ""))


def check_known(
    weights: Path | str | None = None, gripper: str | Path | None = None, object_class: str | None = None
) -> None:
    """Makes sure, before anything heavy is loaded, that weights know a hand and a class.

    Args:
        weights: the file; the shipped one if None.
        gripper: name of a gripper that ships with the package, or a gripper file; None asks for the weights' own.
        object_class: name of a class; None for any.

    Raises:
        DataError: the weights or the gripper cannot be used.
        InputError: another hand, or an unknown class; the message names those that the weights know.
    """
    config = read_header(DEFAULT_WEIGHTS if weights is None else weights).config
    if gripper is not None:
        config.check_hand(load_gripper(gripper), "the grasps that are asked for")
    if object_class is not None:
        class_index(object_class, config.classes)


def stored_checksum(path: Path | str) -> str:
    """SHA-256 of the weights as their file states it; `load_weights` checks that it is true.

    Raises:
        DataError: for a missing, damaged or foreign file.
    """
    return read_header(path).sha256


def _checksum(entries: dict[str, str]) -> str:
    return hashlib.sha256(json.dumps(entries, sort_keys=True).encode()).hexdigest()

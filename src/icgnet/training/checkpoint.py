"""The moving average of the weights, and checkpoints from which a run goes on as if it had not stopped."""

import copy
import io
import pickle
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch
from torch import nn

from icgnet.errors import DataError, InputError
from icgnet.files import new_file
from icgnet.network.config import NetworkConfig
from icgnet.network.icgnet import IcgNet

Network = TypeVar("Network", bound=nn.Module)

CHECKPOINT_FILE = "checkpoint.pt"
FORMAT = 2
"""Since 2, a checkpoint names its network's configuration, and with it hand and classes."""


@dataclass
class Progress:
    """Where a run stands.

    Attributes:
        step: optimiser steps made.
        visits: scenes seen, over all devices; the next sample is that of this visit.
        elapsed: training time of all legs [s].
        validated: the same at the last validation [s].
        best: highest selection score on validation scenes.
        finished: whether the budget is used up and the final weights are written.
    """

    step: int = 0
    visits: int = 0
    elapsed: float = 0.0
    validated: float = 0.0
    best: float = -1.0
    finished: bool = False


class WeightAverage(Generic[Network]):
    """Exponential moving average of a network's weights and normalisation statistics."""

    def __init__(self, network: Network, decay: float) -> None:
        self.network = copy.deepcopy(network).eval().requires_grad_(False)
        self.decay = decay

    @torch.no_grad()
    def update(self, network: nn.Module, step: int) -> None:
        """Moves the average towards the network; faster in the first steps, to forget the initial weights."""
        decay = min(self.decay, (1 + step) / (10 + step))
        source = network.state_dict()
        for name, average in self.network.state_dict().items():
            if average.is_floating_point():
                average.lerp_(source[name], 1.0 - decay)
            else:
                average.copy_(source[name])


def save_checkpoint(
    path: Path,
    progress: Progress,
    network: IcgNet,
    average: WeightAverage,
    optimizer: torch.optim.Optimizer,
) -> None:
    """Writes everything that the next step depends on; the file appears whole or not at all."""
    content = {
        "format": FORMAT,
        "progress": asdict(progress),
        "config": network.config.to_dict(),
        "network": network.state_dict(),
        "average": average.network.state_dict(),
        "optimizer": optimizer.state_dict(),
    }
    serialised = io.BytesIO()
    torch.save(content, serialised)
    with new_file(path) as file:
        file.write(serialised.getbuffer())


def read_checkpoint(path: Path) -> dict[str, Any]:
    """What `save_checkpoint` wrote.

    Raises:
        DataError: the file is damaged or of another version.
    """
    try:
        content: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, EOFError, ValueError, pickle.UnpicklingError) as error:
        raise DataError(f"{path}: not a readable checkpoint ({type(error).__name__})") from error
    if content.get("format") != FORMAT:
        raise DataError(f"{path}: checkpoint of format {content.get('format')}, this version reads {FORMAT}")
    return content


def restore(
    content: dict[str, Any],
    network: IcgNet,
    average: WeightAverage,
    optimizer: torch.optim.Optimizer,
) -> Progress:
    """Puts network, average and optimiser back into the state of a checkpoint, and returns where the run stood.

    Raises:
        DataError: the checkpoint is of another network, hand or classes.
    """
    try:
        differences = network.config.differences(NetworkConfig.from_dict(content["config"]))
    except InputError as error:
        raise DataError(f"the checkpoint is not of this version of icgnet ({error})") from error
    if differences:
        raise DataError(f"the checkpoint is of another network: {', '.join(differences)}")
    network.load_state_dict(content["network"])
    average.network.load_state_dict(content["average"])
    optimizer.load_state_dict(content["optimizer"])
    return Progress(**content["progress"])

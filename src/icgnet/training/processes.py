"""The processes that train together: this one alone, or all that `torchrun` started."""

import os
from datetime import timedelta
from typing import Any, Literal

import torch
from jaxtyping import Float
from lightning_fabric import Fabric
from lightning_fabric.strategies.ddp import DDPStrategy
from torch import Tensor

from icgnet.errors import DataError, InputError

Accelerator = Literal["auto", "cpu", "gpu"]

PATIENCE = timedelta(hours=1)
"""How long the others wait for the first process, which alone validates and writes."""


def join_processes(accelerator: Accelerator = "auto") -> Fabric:
    """This process with its device, connected with the others that `torchrun` started, if it did.

    Args:
        accelerator: what to compute on; "auto" takes a GPU where there is one.

    Raises:
        InputError: fewer GPUs than processes on this node.
    """
    launched = torch.distributed.is_available() and torch.distributed.is_torchelastic_launched()
    world, local = (int(os.environ[name]) if launched else 1 for name in ("WORLD_SIZE", "LOCAL_WORLD_SIZE"))
    gpus = torch.cuda.device_count() or int(torch.backends.mps.is_available())
    wants_gpus = accelerator == "gpu" or (accelerator == "auto" and gpus > 0)
    if wants_gpus and gpus < local:
        raise InputError(f"{local} processes on this node, but {gpus} GPUs: start fewer, or choose accelerator cpu")
    # Before every forward pass the buffers of the first process go to all: torch's default, and what keeps the running
    # statistics of the batch normalisation alike where each process takes its own.
    together = DDPStrategy(
        timeout=PATIENCE,
        # A term that no scene of a process has leaves a decoder without gradient there.
        find_unused_parameters=True,
    )
    fabric = Fabric(
        accelerator=accelerator,
        devices=local,
        num_nodes=world // local,
        strategy=together if world > 1 else "auto",
    )
    fabric.launch()
    return fabric


def total(fabric: Fabric, values: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """The sum of some numbers over all processes, on the CPU; every process has to ask for it."""
    if fabric.world_size == 1:
        return values
    summed = fabric.all_reduce(values.to(fabric.device), reduce_op="sum")
    assert isinstance(summed, Tensor)
    return summed.cpu()


def agreed(fabric: Fabric, value: float) -> float:
    """The mean of a number over all processes, so that what is decided by it is decided alike."""
    return float(total(fabric, torch.tensor(value, dtype=torch.float64))) / fabric.world_size


def check_same(fabric: Fabric, own: dict[str, Any]) -> None:
    """Makes sure that every process has the same: else they would wait for each other for ever.

    Args:
        fabric: of the process.
        own: what has to be the same, by name.

    Raises:
        DataError: in a process that has something else than the first; the message names what.
    """
    first = fabric.broadcast(own)
    other = [name for name, value in own.items() if first.get(name) != value]
    if other:
        differences = "; ".join(f"{name}: {own[name]} here, {first.get(name)} there" for name in other)
        raise DataError(f"process {fabric.global_rank} has not what the first has; {differences}")

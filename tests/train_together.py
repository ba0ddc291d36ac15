"""Trains on the small world of `shape_scenes`, alone or in processes that are connected as `torchrun` connects them.

The processes come from a server that has imported everything once: started one by one, each would do that for itself.
"""

import os
import socket
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import pytest
from torch.nn import functional

from icgnet.network.config import NETWORKS
from icgnet.training.config import TRAININGS, Sampling, TrainingConfig
from icgnet.training.loop import train
from shape_scenes import ShapeSet

STEPS = 3


@dataclass(frozen=True)
class Leg:
    """So many steps (None: to the end) of the run in a folder, for each process its own, with these statistics."""

    folders: tuple[Path, Path]
    steps: int | None = None
    common_statistics: bool = True


def configuration(batch: int, common_statistics: bool = True) -> TrainingConfig:
    """A short run of preset `tiny` in float32."""
    return replace(
        TRAININGS["tiny"],
        batch=batch,
        common_statistics=common_statistics,
        steps=STEPS,
        sampling=Sampling(occupancy_points=64, contacts=8, half_resolution=1.0),
        log_seconds=0.0,
        warmup_steps=0,
    )


def prepare(patch: pytest.MonkeyPatch) -> None:
    """Makes the shapes the only object set, and takes out of training what differs for reasons of its own.

    Which tokens are left out is drawn in each process, so all are kept. And torch's batch normalisation of grids in
    channels-last order adds up 100,000 cells one by one, which is wrong in the fourth digit (torch 2.13, CPU).
    """
    patch.setattr("icgnet.training.validation.load_object_set", lambda source: ShapeSet())
    patch.setitem(NETWORKS, "tiny", replace(NETWORKS["tiny"], tokens_per_level=(10**6,) * 4))
    normalise = functional.batch_norm
    patch.setattr(functional, "batch_norm", lambda input, *rest: normalise(input.contiguous(), *rest))


def train_together(data: Path, legs: list[Leg], nodes: int = 1) -> str:
    """Lets two processes of batch 2, on one node or on two, train all legs; returns what they report."""
    context = get_context("forkserver")
    context.set_forkserver_preload(["train_together"])
    ports = _free_ports(len(legs))
    processes = [context.Process(target=_train_all, args=(rank, nodes, data, legs, ports)) for rank in range(2)]
    for process in processes:
        process.start()
    for process in processes:
        process.join(240)
        process.kill()
    assert [process.exitcode for process in processes] == [0, 0]
    return "".join((data / f"said_{rank}").read_text() for rank in range(2))


def _train_all(rank: int, nodes: int, data: Path, legs: list[Leg], ports: list[int]) -> None:
    local = {"LOCAL_WORLD_SIZE": 2 // nodes, "LOCAL_RANK": rank % (2 // nodes), "GROUP_RANK": rank * nodes // 2}
    world = {"TORCHELASTIC_RUN_ID": "test", "WORLD_SIZE": 2, "RANK": rank, "MASTER_ADDR": "127.0.0.1"}
    os.environ |= {name: str(value) for name, value in (local | world).items()}
    prepare(pytest.MonkeyPatch())
    with (data / f"said_{rank}").open("w") as said:
        for leg, port in zip(legs, ports, strict=True):
            os.environ["MASTER_PORT"] = str(port)
            train(
                configuration(2, leg.common_statistics),
                [data],
                leg.folders[rank],
                ["shapes"],
                report=lambda line: print(line, file=said, flush=True),
                leg_steps=leg.steps,
                accelerator="cpu",
            )


def _free_ports(count: int) -> list[int]:
    servers = [socket.socket() for _ in range(count)]
    for server in servers:
        server.bind(("127.0.0.1", 0))
    ports = [server.getsockname()[1] for server in servers]
    for server in servers:
        server.close()
    return ports

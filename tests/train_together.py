"""Trains on the small world of `shape_scenes`, alone or as one of the processes of `torchrun`.

    torchrun --nproc-per-node=2 tests/train_together.py DATA BATCH [OUT LEG_STEPS STATISTICS ...]

Trains in every folder for so many steps (0 goes on to the end), with "common" statistics or with each process's "own".
"""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from torch.nn import functional

from icgnet.network.config import NETWORKS
from icgnet.training.config import TRAININGS, Sampling, TrainingConfig
from icgnet.training.loop import train
from shape_scenes import ShapeSet

STEPS = 6


def configuration(batch: int, common_statistics: bool = True) -> TrainingConfig:
    """A short run of preset `tiny` in float32."""
    return replace(
        TRAININGS["tiny"],
        batch=batch,
        common_statistics=common_statistics,
        steps=STEPS,
        sampling=Sampling(occupancy_points=64, contacts=8, half_resolution=1.0),
        log_seconds=0.0,
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


if __name__ == "__main__":
    prepare(pytest.MonkeyPatch())
    data, batch, *runs = sys.argv[1:]
    for out, leg_steps, statistics in zip(runs[::3], runs[1::3], runs[2::3], strict=True):
        train(
            configuration(int(batch), statistics == "common"),
            [Path(data)],
            Path(out),
            ["shapes"],
            report=lambda line: print(line, flush=True),
            leg_steps=int(leg_steps) or None,
            accelerator="cpu",
        )

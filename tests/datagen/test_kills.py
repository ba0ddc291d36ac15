"""kill -9 at any moment: nothing finished is lost, nothing is half written, the next start goes on."""

import os
import time
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np
import pytest

from icgnet.datagen.config import GenerateConfig, LabelSettings
from icgnet.datagen.generate import generate
from icgnet.datagen.recipe import read_shard
from shape_scenes import HEADER

KILLS = 10
CONFIG = GenerateConfig(
    scene="pile", scenes=60, seed=3, shard_scenes=1, labels=LabelSettings(contacts=2, object_count=1)
)


def finished(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.parquet"))}


def start(folder: Path, config: GenerateConfig) -> BaseProcess:
    """A run in a process of its own, from a server that has imported everything once."""
    context = get_context("forkserver")
    context.set_forkserver_preload(["icgnet.datagen.generate"])
    run = context.Process(target=generate, args=(folder, config))
    run.start()
    return run


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_ten_kills_at_random_moments_lose_nothing_that_was_finished(tmp_path):
    """Each start must get one to two files further, so that kills fall on the making and on the writing of scenes."""
    folder = tmp_path / "killed"
    rng = np.random.default_rng(0)
    before: dict[str, bytes] = {}
    for kill in range(KILLS):
        wanted = len(before) + int(rng.integers(1, 3))
        run = start(folder, replace(CONFIG, workers=2 if kill == 5 else 1))
        while len(list(folder.glob("*.parquet"))) < wanted:
            assert run.is_alive()
            time.sleep(0.001)
        time.sleep(rng.uniform(0.0, 0.2))
        run.kill()
        run.join()
        after = finished(folder)
        assert after.items() >= before.items(), "a file that was finished is lost or changed"
        new = after.keys() - before.keys()
        assert all(len(read_shard(folder / name, HEADER)) == CONFIG.shard_scenes for name in new)
        before = after
    count = len(before) + 3
    assert count <= CONFIG.scenes, "the run was over before the last kill"
    config = replace(CONFIG, scenes=count)
    report = generate(folder, config)
    assert report.scenes_found == len(before)
    generate(tmp_path / "undisturbed", config)
    assert finished(folder) == finished(tmp_path / "undisturbed")
    assert not list(folder.glob("*.partial"))

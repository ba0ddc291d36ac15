"""The same work on a Ray cluster, started here and small."""

import os
import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

import pytest

from datagen_jobs import FatalJob, FaultyJob, QuickJob, make
from icgnet.datagen.config import GenerateConfig, LabelSettings
from icgnet.datagen.generate import generate
from icgnet.errors import DataError, InputError
from icgnet.parallel.cluster import RayPool
from icgnet.parallel.pool import TRIES

CONFIG = GenerateConfig(scenes=5, seed=5, shard_scenes=2, labels=LabelSettings(contacts=2, object_count=1))


@pytest.fixture(scope="module")
def cluster() -> Iterator[RayPool]:
    """A local cluster of two processors, which the pools that are made meanwhile join."""
    ray = pytest.importorskip("ray", reason='needs Ray: pip install "icgnet[cluster]"')
    with pytest.MonkeyPatch.context() as patch:
        # The cluster's processes import the jobs of these tests, and the package from where these tests do.
        patch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        pool = RayPool(make(QuickJob), "local", 2)
    yield pool
    pool.close()
    assert not ray.is_initialized()


def files(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.parquet"))}


@pytest.mark.ray
@pytest.mark.slow
def test_a_cluster_writes_the_same_files_as_one_worker(cluster, tmp_path):
    generate(tmp_path / "here", CONFIG)
    report = generate(tmp_path / "there", replace(CONFIG, ray="local"))
    assert len(files(tmp_path / "here")) == 3
    assert files(tmp_path / "there") == files(tmp_path / "here")
    assert report.workers == 2


@pytest.mark.ray
def test_a_cluster_makes_every_scene_once(cluster):
    assert cluster.workers == 2
    assert sorted(recipe.scene_id for recipe in cluster.make(range(20))) == list(range(20))


@pytest.mark.ray
@pytest.mark.slow
def test_a_scene_whose_worker_died_is_made_by_another(cluster, tmp_path):
    with closing(RayPool(make(FatalJob, 1, 1, tmp_path), "local", 2)) as pool:
        assert sorted(recipe.scene_id for recipe in pool.make(range(4))) == [0, 1, 2, 3]
    assert len(list(tmp_path.iterdir())) == 1
    assert cluster.workers == 2, "who joins a cluster does not end it"


@pytest.mark.ray
@pytest.mark.slow
def test_a_scene_that_kills_every_worker_is_named(cluster, tmp_path):
    pool = RayPool(make(FatalJob, 1, 100, tmp_path), "local", 2)
    with pytest.raises(DataError, match=rf"scene 1 \(seed 4\): lost on the cluster {TRIES} times"):
        list(pool.make(range(16)))
    assert len(list(tmp_path.iterdir())) == 2 * TRIES, "first with another scene in the same task, then alone"


@pytest.mark.ray
def test_an_error_in_a_scene_is_raised_here(cluster):
    with pytest.raises(ZeroDivisionError, match="a bug"):
        list(RayPool(make(FaultyJob), "local", 2).make([2]))


@pytest.mark.ray
def test_a_machine_with_another_version_is_refused(cluster, monkeypatch):
    monkeypatch.setattr("icgnet.__version__", "99.0")
    with pytest.raises(InputError, match=r"this machine has icgnet 99\.0, a machine of the cluster has"):
        list(cluster.make([0]))


def test_without_ray_the_error_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(InputError, match=r'pip install "icgnet\[cluster\]"'):
        RayPool(make(QuickJob), "local", 1)


@pytest.mark.ray
@pytest.mark.parametrize("address", ["127.0.0.1:1", "ray://127.0.0.1:1"])
def test_an_address_without_a_cluster_is_refused_at_once(address, monkeypatch):
    ray = pytest.importorskip("ray", reason='needs Ray: pip install "icgnet[cluster]"')
    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    with pytest.raises(InputError, match=f"no Ray cluster at '{address}'.*refused"):
        RayPool(make(QuickJob), address, 1)


@pytest.mark.parametrize("address", ["", "nowhere", "host:", "http://host:1"])
def test_what_cannot_be_an_address_is_refused_before_anything_is_written(address):
    with pytest.raises(InputError, match=f'ray must be "local", "auto", host:port or ray://host:port, got {address!r}'):
        replace(CONFIG, ray=address)

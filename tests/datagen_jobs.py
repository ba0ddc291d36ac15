"""Jobs for the tests of the pools: no physics, but workers that die. Worker processes import them from here."""

import os
import signal
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from icgnet.datagen.config import GenerateConfig
from icgnet.datagen.job import GenerateJob
from icgnet.datagen.recipe import Recipe, RecipeContacts
from icgnet.grasping.gripper import load_gripper
from icgnet.objects.object_set import load_object_set
from icgnet.parallel.pool import LocalPool


def make(job_class: type[GenerateJob], *arguments) -> GenerateJob:
    return job_class(GenerateConfig(seed=4), load_object_set("procedural"), load_gripper("franka"), *arguments)


def empty_recipe(scene_id: int) -> Recipe:
    none, vectors, bits = np.zeros(0), np.zeros((0, 3), np.float32), np.zeros(0, np.uint16)
    contacts = RecipeContacts(vectors, vectors, none.astype(np.int64), none.astype(np.float32), bits, bits, bits)
    return Recipe(scene_id, "pile", "procedural", "train", 4, load_gripper("franka"), (), contacts)


@dataclass(frozen=True)
class QuickJob(GenerateJob):
    def make(self, number: int) -> Recipe:
        return empty_recipe(number)


@dataclass(frozen=True)
class FatalJob(GenerateJob):
    """The scene `fatal` kills its workers until so many of them have left their mark in a folder."""

    fatal: int
    deaths: int
    marks: Path

    def make(self, number: int) -> Recipe:
        if number == self.fatal and len(list(self.marks.iterdir())) < self.deaths:
            (self.marks / str(os.getpid())).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return empty_recipe(number)


@dataclass(frozen=True)
class FaultyJob(GenerateJob):
    """The scene 2 raises an error that nobody has foreseen."""

    def make(self, number: int) -> Recipe:
        if number == 2:
            raise ZeroDivisionError("a bug")
        return empty_recipe(number)


@dataclass(frozen=True)
class EndlessJob(GenerateJob):
    """Leaves a mark with its process's number, and then works for a minute without listening to anybody."""

    marks: Path

    def make(self, number: int) -> Recipe:
        (self.marks / f"begun_{os.getpid()}").touch()
        end = time.monotonic() + 60.0
        while time.monotonic() < end:
            pass
        return empty_recipe(number)


def work_endlessly(marks: Path) -> None:
    """What the test of orphans runs in a process of its own."""
    # What runs in the background of a shell script ignores SIGINT, and so do its children.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with closing(LocalPool(make(EndlessJob, marks), 1)) as pool:
        list(pool.make([0]))

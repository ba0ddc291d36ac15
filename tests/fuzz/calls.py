"""Calls icgnet with whatever callers get wrong: `make fuzz`, or `python -m fuzz.calls --calls 300 --seed 7` in tests/.

A call must answer with finite numbers, or refuse with one line that is an `IcgnetError`, within ten seconds. Each has
its own seed, which is printed where it fails and with which `--seed N --calls 1` repeats it.
"""

import argparse
import json
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image

import icgnet
from fuzz.strange import NASTY, break_arrays, break_bytes, break_entries, strange
from icgnet.datagen.recipe import (
    MANIFEST,
    Recipe,
    RecipeContacts,
    RecipeObject,
    read_manifest,
    read_shard,
    write_shard,
)
from icgnet.errors import IcgnetError
from icgnet.geometry.camera import unproject
from icgnet.geometry.clouds import PointCloud
from icgnet.grasping.gripper import load_gripper
from icgnet.inference.capture import read_camera_pose, read_capture, read_intrinsics, read_mask
from icgnet.inference.grasp_search import GraspSearch
from icgnet.inference.prediction import Prediction
from icgnet.network.weights import load_weights, save_weights
from icgnet.predictor import Predictor
from shape_scenes import HEADER
from tabletop_scenes import INTRINSICS, THREE_BOXES, camera_pose, depth_image, tiny_network

LONGEST_CALL = 10.0
"""CPU time of a call at most [s]."""
LONGEST_MESSAGE = 2000
SHIPPED = 200
"""One of so many calls of the predictor takes the shipped network."""


@dataclass(frozen=True)
class Failure:
    """A call that did not behave, and what it did."""

    target: str
    seed: int
    what: str


class Calls:
    """The calls, and the sound inputs that they spoil; all of it is made on first use."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @cached_property
    def predictor(self) -> Predictor:
        search = GraspSearch(contacts=32, max_checked=48, few=1)
        return Predictor(tiny_network(), load_gripper(), search)

    @cached_property
    def shipped(self) -> Predictor:
        return Predictor.load(threads=1)

    @cached_property
    def depth(self) -> np.ndarray:
        return depth_image(THREE_BOXES, camera_pose())[::2, ::2]

    @cached_property
    def intrinsics(self) -> np.ndarray:
        return np.diag([0.5, 0.5, 1.0]) @ INTRINSICS

    @cached_property
    def saved(self) -> Path:
        path = self.folder / "saved"
        self.predictor.predict_depth(self.depth, self.intrinsics).save(path)
        return path

    @cached_property
    def weights(self) -> Path:
        path = self.folder / "tiny.safetensors"
        save_weights(path, tiny_network(), {})
        return path

    @cached_property
    def recipe_file(self) -> Path:
        one = np.zeros(1, dtype=np.float32)
        placed = RecipeObject("pile/a", "box", 1.0, np.zeros(3, np.float32), np.array([1, 0, 0, 0], np.float32))
        bits = np.zeros(1, dtype=np.uint16)
        places = np.zeros((1, 3), dtype=np.float32)
        contacts = RecipeContacts(places, places + 1, np.zeros(1, dtype=np.int64), one, bits, bits, bits)
        path = self.folder / "scenes-0000000.parquet"
        write_shard(path, [Recipe(0, "pile", "things", "train", 0, HEADER.gripper, (placed,), contacts)], HEADER)
        return path

    def depth_images(self, rng: np.random.Generator) -> Prediction:
        """The predictor with a depth image of which one or two things are strange."""
        given: dict[str, Any] = {"depth": self.depth, "intrinsics": self.intrinsics}
        if rng.random() < 0.6:
            given["camera_pose"] = camera_pose()
            if rng.random() < 0.5:
                given["table_height"] = np.array(0.05)
        if rng.random() < 0.3:
            given["mask"] = rng.random(self.depth.shape) < 0.5
        for name in rng.choice(list(given), size=rng.integers(1, min(3, len(given) + 1)), replace=False):
            given[name] = strange(rng, given[name])
        return self._predictor(rng).predict_depth(**given, level_table=bool(rng.random() < 0.1))

    def noise(self, rng: np.random.Generator) -> Prediction:
        """The predictor with a picture of nothing but noise."""
        depth = 0.6 + rng.normal(0.0, rng.choice([0.003, 0.02, 0.1]), self.depth.shape)
        height = [None, 0.0][rng.integers(2)]
        return self._predictor(rng).predict_depth(depth, self.intrinsics, np.diag([1.0, -1, -1, 1]), height)

    def clouds(self, rng: np.random.Generator) -> Prediction:
        """The predictor with a cloud of which something is strange."""
        points = unproject(self.depth, self.intrinsics).reshape(-1, 3)
        given: dict[str, Any] = {"points": points}
        if rng.random() < 0.4:
            given["viewpoint"] = np.zeros(3)
        if rng.random() < 0.4:
            given["table_height"] = np.array(-0.5)
        name = rng.choice(list(given))
        given[name] = strange(rng, given[name])
        result = self._predictor(rng).predict_cloud(**given)
        return result.in_region(strange(rng, -np.ones(3)), np.ones(3)) if rng.random() < 0.2 else result

    def _predictor(self, rng: np.random.Generator) -> Predictor:
        return self.shipped if rng.integers(SHIPPED) == 0 else self.predictor

    def captures(self, rng: np.random.Generator) -> Any:
        """Readers of images, clouds and masks with broken files."""
        kind = rng.choice(["npz", "npy", "png", "tif", "ply", "xyz", "csv", "mask.png"])
        path = self.folder / f"capture.{kind}"
        points = unproject(self.depth, self.intrinsics).reshape(-1, 3)[:200]
        if kind == "npz":
            np.savez(path, depth=self.depth, K=self.intrinsics, camera_pose=camera_pose())
        elif kind == "npy":
            np.save(path, points)
        elif kind in ("png", "tif", "mask.png"):
            Image.fromarray((1000 * self.depth).astype(np.uint16)).save(path)
        elif kind == "ply":
            import trimesh

            trimesh.PointCloud(points).export(path, encoding=str(rng.choice(["ascii", "binary"])))
        else:
            np.savetxt(path, points, delimiter="," if kind == "csv" else " ")
        if kind == "npz" and rng.random() < 0.5:
            break_arrays(rng, path)
        else:
            break_bytes(rng, path)
        if kind == "mask.png":
            return read_mask(path)
        return read_capture(path, ("50", "50", "40", "30") if kind in ("png", "tif") else (), 1000.0)

    def calibrations(self, rng: np.random.Generator) -> Any:
        """Readers of camera matrices and poses with broken files and options."""
        if rng.random() < 0.2:
            words = [str(NASTY[rng.integers(len(NASTY))]) for _ in range(rng.integers(1, 18))]
            return [read_intrinsics, read_camera_pose][rng.integers(2)](words)
        kind = rng.choice(["json", "yaml", "npz"])
        path = self.folder / f"calibration.{kind}"
        entries = {"K": self.intrinsics.tolist(), "camera_pose": camera_pose().tolist()}
        if kind == "npz":
            np.savez(path, **entries)
            break_arrays(rng, path)
        else:
            broken = break_entries(rng, entries)
            path.write_text(json.dumps(broken) if kind == "json" else yaml.safe_dump(broken))
            if rng.random() < 0.3:
                break_bytes(rng, path)
        return [read_intrinsics, read_camera_pose][rng.integers(2)]([str(path)])

    def grippers(self, rng: np.random.Generator) -> Any:
        """The reader of hands with broken files."""
        source = Path(icgnet.__file__).parent / "grasping" / "grippers" / "franka.yaml"
        # A name of its own: readers may remember files.
        path = self.folder / f"gripper_{rng.integers(2**60)}.yaml"
        path.write_text(yaml.safe_dump(break_entries(rng, yaml.safe_load(source.read_text()))))
        if rng.random() < 0.3:
            break_bytes(rng, path)
        try:
            gripper = load_gripper(path)
            return [*(box.size for box in (*gripper.palm, *gripper.finger)), gripper.max_opening, gripper.clearance]
        finally:
            path.unlink()

    def predictions(self, rng: np.random.Generator) -> Any:
        """The reader of saved predictions with broken files."""
        path = self.folder / "broken"
        shutil.rmtree(path, ignore_errors=True)
        shutil.copytree(self.saved, path)
        name = rng.choice(["result.json", "result.json", "grasps.npz", "cloud.npz"])
        if rng.random() < 0.2:
            break_bytes(rng, path / name)
        elif name == "result.json":
            entries = json.loads((path / name).read_text())
            (path / name).write_text(json.dumps(break_entries(rng, entries)))
        else:
            break_arrays(rng, path / name)
        result = Prediction.load(path)
        result.distinct(), result.highest(), result.instance_mask
        result.save(self.folder / "again", overwrite=True)
        return result

    def weights_files(self, rng: np.random.Generator) -> Any:
        """The reader of weights with broken files."""
        path = self.folder / "broken.safetensors"
        content = self.weights.read_bytes()
        length = int.from_bytes(content[:8], "little")
        header = json.loads(content[8 : 8 + length])
        config = json.loads(header["__metadata__"]["config"])
        header["__metadata__"]["config"] = json.dumps(break_entries(rng, {"config": config}).get("config"))
        text = json.dumps(header).encode()
        path.write_bytes(len(text).to_bytes(8, "little") + text + content[8 + length :])
        if rng.random() < 0.4:
            break_bytes(rng, path)
        network, _ = load_weights(path)
        return Predictor(network, load_gripper(), self.predictor.search).predict_depth(self.depth, self.intrinsics)

    def recipes(self, rng: np.random.Generator) -> Any:
        """The readers of recipes and their manifest with broken files."""
        path = self.folder / "recipes"
        path.mkdir(exist_ok=True)
        if rng.random() < 0.3:
            manifest = {**HEADER.to_dict(), "objects": {"pile/a": "0"}}
            (path / MANIFEST).write_text(json.dumps(break_entries(rng, manifest)))
            read_manifest(path)
            return None
        shard = path / self.recipe_file.name
        shutil.copy(self.recipe_file, shard)
        break_bytes(rng, shard)
        return [recipe.contacts.widths for recipe in read_shard(shard, HEADER)]


SHARES: dict[str, float] = {
    **{"depth_images": 30, "noise": 1, "clouds": 12, "captures": 20, "calibrations": 12},
    **{"grippers": 10, "predictions": 10, "weights_files": 3, "recipes": 2},
}
"""How often each kind of call comes [%]."""


def run(calls: int, seed: int, skip: tuple[str, ...] = ()) -> tuple[Counter[tuple[str, str]], list[Failure]]:
    """Makes so many calls with the seeds from `seed` on; returns what came of them, and those that did not behave."""
    names = list(SHARES)
    counts: Counter[tuple[str, str]] = Counter()
    failures = []
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        targets = Calls(Path(folder))
        for number in range(seed, seed + calls):
            rng = np.random.default_rng(number)
            name = str(rng.choice(names, p=np.array(list(SHARES.values())) / sum(SHARES.values())))
            if name in skip:
                continue
            outcome, what = _outcome(getattr(targets, name), rng)
            counts[name, outcome] += 1
            if what:
                failures.append(Failure(name, number, what))
    return counts, failures


def _outcome(call: Callable[[np.random.Generator], Any], rng: np.random.Generator) -> tuple[str, str]:
    """What came of a call in a word, and what is wrong with that, if anything."""
    start = time.process_time()
    try:
        result = call(rng)
    except IcgnetError as error:
        message = str(error)
        is_clear = message and "\n" not in message and len(message) <= LONGEST_MESSAGE
        outcome, what = "refused", "" if is_clear else f"unclear message: {message[:200]!r}"
    except Exception as error:
        line = traceback.extract_tb(error.__traceback__)[-1]
        outcome = "foreign exceptions"
        what = f"{type(error).__name__} {str(error)[:200]!r} in {Path(line.filename).name}:{line.lineno}"
    else:
        is_finite = _is_finite(result)
        outcome, what = ("answered", "") if is_finite else ("not finite", "a result that is not finite")
    if (took := time.process_time() - start) > LONGEST_CALL:
        return "too long", f"took {took:.1f} s; {what}"
    return outcome, what


def _is_finite(result: Any) -> bool:
    if isinstance(result, Prediction):
        grasps = result.grasps
        arrays = [grasps.poses, grasps.widths, grasps.openings, grasps.scores, result.T_frame_table]
        return all(np.isfinite(array).all() for array in (*arrays, result.cloud.points))
    if isinstance(result, PointCloud) or hasattr(result, "depth") or result is None:
        return True  # what was not measured is NaN there
    if isinstance(result, list):
        return all(map(_is_finite, result))
    return bool(np.isfinite(result).all())


def main() -> int:
    """Makes the calls, prints what came of them, and returns how many did not behave, at most 1."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    start = time.perf_counter()
    counts, failures = run(options.calls, options.seed)
    for failure in failures:
        print(f"seed {failure.seed} ({failure.target}): {failure.what}")
    for name in SHARES:
        print(f"{name:14}", ", ".join(f"{counts[each]} {each[1]}" for each in sorted(counts) if each[0] == name))
    print(f"{sum(counts.values())} calls in {time.perf_counter() - start:.0f} s, {len(failures)} did not behave")
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main())

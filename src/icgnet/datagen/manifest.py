"""The manifest of a recipe folder: everything that decides what its rows are."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from icgnet.datagen.job import GenerateJob
from icgnet.datagen.recipe import MANIFEST, LabelHeader, read_manifest
from icgnet.datagen.usable_objects import first_of
from icgnet.errors import DataError
from icgnet.files import write_json
from icgnet.grasping.frame import APPROACH_ANGLES
from icgnet.objects.kinds import Kind
from icgnet.parallel.lock import LOCK, OWNER

ONLY_TOLD = {"code_version", "object_counts", "left_out", "doubtful", "never_drawn"}
"""What the manifest tells its readers, but what does not decide what the rows are, or follows from the rest."""

OURS = {LOCK, OWNER}
"""What lies in an empty folder that a run holds."""

COMPARED_APART = {"objects", "gripper", "classes"}


def make_manifest(
    job: GenerateJob, doubtful: Mapping[str, str], never_drawn: Mapping[Kind, Mapping[str, str]]
) -> dict[str, object]:
    """What decides the rows of a job, and the version of the code that makes them.

    Args:
        job: the job; its object set has been relieved of what cannot be used.
        doubtful: objects that are used although something about them is odd, with what that is.
        never_drawn: objects that no table or bin is large enough for, or that are too small, with their longest side.
    """
    config = job.config
    keys = {kind: job.object_set.names(kind, config.split) for kind in config.kinds}
    manifest = {
        **job.header.to_dict(),
        "code_version": _code_version(),
        "object_set": job.object_set.name,
        "object_counts": {kind: len(names) for kind, names in keys.items()},
        "split": config.split,
        "scene": config.scene,
        "seed": config.seed,
        "shard_scenes": config.shard_scenes,
        "angles_deg": np.rad2deg(APPROACH_ANGLES).round(6).tolist(),
        "hands": config.hands,
        "family": asdict(config.family) if config.hands == "family" else None,
        **asdict(config.labels),
        "left_out": dict(job.object_set.left_out),
        "doubtful": dict(doubtful),
        "never_drawn": {kind: dict(sides) for kind, sides in never_drawn.items()},
        "objects": {key: job.object_set.fingerprint(key) for names in keys.values() for key in names},
    }
    # As it will be read back, so that the two can be compared.
    return json.loads(json.dumps(manifest))


def prepare_folder(directory: Path, manifest: Mapping[str, object]) -> None:
    """Gives an empty folder its manifest, or checks that the one that is there asks for the same rows.

    Raises:
        DataError: other files without a manifest, a broken one, or one that asks for other rows: the message says in
            what they differ.
    """
    path = directory / MANIFEST
    if not path.exists():
        foreign = sorted(each.name for each in directory.iterdir() if each.name not in OURS)
        if foreign:
            raise DataError(f"{directory}: holds other files ({foreign[0]}) and no {MANIFEST}; give another folder")
        write_json(path, manifest)
        return
    differences = _differences(read_manifest(directory), manifest)
    if differences:
        raise DataError(f"{directory}: made with another configuration: {'; '.join(differences)}")


def _differences(there: Mapping[str, object], now: Mapping[str, object]) -> list[str]:
    path = Path(MANIFEST)
    labels = LabelHeader.from_dict(now, path).differences(LabelHeader.from_dict(there, path))
    differences = labels + [
        f"{key} is {there[key]} there, {now.get(key)} now" if key in there else f"{key} is not recorded there"
        for key in sorted((there.keys() | now.keys()) - ONLY_TOLD - COMPARED_APART)
        if there.get(key) != now.get(key)
    ]
    # With another set or split, all objects differ, which is no news.
    return differences or _object_differences(there.get("objects"), now["objects"])


def _object_differences(there: object, now: object) -> list[str]:
    if there == now:
        return []
    if not (isinstance(there, dict) and isinstance(now, dict)):
        return ["objects are not recorded there"]
    changes = [
        f"{name} is {'gone' if name not in now else 'new' if name not in there else 'changed'}"
        for name in sorted(there.keys() | now.keys())
        if there.get(name) != now.get(name)
    ]
    return [f"objects differ: {first_of(changes)}"]


def _code_version() -> str:
    try:
        return version("icgnet")
    except PackageNotFoundError:
        return "unknown"

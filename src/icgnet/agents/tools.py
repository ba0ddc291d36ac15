"""What an agent can ask: plain questions, plain answers. Nothing here knows the protocol, and nothing moves."""

import threading
from collections import OrderedDict
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from icgnet.agents.captures import CaptureFolder
from icgnet.agents.sight import PickWish, Seen, Sight
from icgnet.errors import InputError
from icgnet.files import write_json
from icgnet.geometry.arrays import described, position
from icgnet.geometry.transforms import matrix_to_quaternion
from icgnet.settings import check_choice
from icgnet.viewer.camera_picture import camera_picture

REMEMBERED = 8
"""So many captures are not looked at again while their files stay the same."""
MOST_GRASPS = 50
RELEASES = ("drop", "place")
GRASP_FRAME = "z approach, y closing, origin midway between the finger tips"


@dataclass(frozen=True, eq=False)
class Look:
    """A look at a capture.

    Attributes:
        picture: what the camera sees, objects in colours with their numbers.
        table: the objects as text, one a line.
        scene: the same as values, as `Tools.list_objects` gives them.
    """

    picture: Image.Image
    table: str
    scene: dict[str, Any]


class Tools:
    """The tools. One question is answered at a time.

    Args:
        captures: what may be looked at.
        sight: finds objects and plans picks.
        plans: folder that plans are written to; None, and then nothing is written at all.
    """

    def __init__(self, captures: CaptureFolder, sight: Sight, plans: Path | None = None) -> None:
        self._captures, self._sight, self._plans = captures, sight, plans
        self._known: OrderedDict[tuple[str, tuple[int, int]], Seen] = OrderedDict()
        self._lock = threading.Lock()

    @property
    def writes(self) -> bool:
        """Whether plans are written to a folder."""
        return self._plans is not None

    def look(self, capture: str | None = None) -> Look:
        """A picture and a table of what is in a capture, the newest one if none is named.

        Raises:
            IcgnetError: there is no such capture, or it is no scene.
        """
        with self._lock:
            seen = self._seen(capture)
            scene = self._scene(seen)
        names = {item["instance_id"]: f"{item['instance_id']} {item['class_name']}" for item in scene["objects"]}
        content = seen.capture.content
        return Look(
            camera_picture(content.depth, content.intrinsics, seen.instance_mask, names), _as_text(scene), scene
        )

    def list_objects(self, capture: str | None = None) -> dict[str, Any]:
        """The objects in a capture: number, class, how sure, where, how large, grasps; and why others have none.

        Raises:
            IcgnetError: there is no such capture, or it is no scene.
        """
        with self._lock:
            return self._scene(self._seen(capture))

    def grasp(
        self,
        capture: str | None = None,
        object_class: str | None = None,
        instance_id: int | None = None,
        limit: int = 3,
    ) -> dict[str, Any]:
        """The best grasps in a capture, of one class or object if it is named.

        Raises:
            IcgnetError: there is no such capture, class or object, or it is no scene.
        """
        if not 1 <= limit <= MOST_GRASPS:
            raise InputError(f"limit must be at least 1 and at most {MOST_GRASPS}, got {limit}")
        with self._lock:
            seen = self._seen(capture)
        _check_wish(seen, object_class, instance_id)
        found = [
            grasp
            for grasp in seen.result["grasps"]
            if object_class in (None, grasp["class_name"]) and instance_id in (None, grasp["instance_id"])
        ]
        return {
            "capture": seen.capture.name,
            "frame_id": seen.result["frame_id"],
            "convention": GRASP_FRAME,
            "found": len(found),
            "grasps": [_grasp_entry(grasp) for grasp in found[:limit]],
            "rejected": _rejected(seen, object_class, instance_id),
            "warnings": seen.result["warnings"],
        }

    def pick(
        self,
        drop: list[float],
        capture: str | None = None,
        object_class: str | None = None,
        instance_id: int | None = None,
        release: str | None = None,
    ) -> dict[str, Any]:
        """A plan by which the arm picks an object; nothing moves.

        Raises:
            IcgnetError: there is no arm, no such capture, class or object, or it cannot plan there.
        """
        x, y, z = position(drop, "drop").tolist()
        if release is not None:
            check_choice("release", release, RELEASES)
        with self._lock:
            seen = self._seen(capture)
            _check_wish(seen, object_class, instance_id)
            plan = self._sight.plan(seen, PickWish((x, y, z), object_class, instance_id, release))
            saved = self._save(plan) if plan["phases"] else None
        number = plan["instance_id"]
        return {
            "moved": False,
            "found": bool(plan["phases"]),
            "capture": seen.capture.name,
            "arm": plan["arm"],
            "instance_id": number,
            "T_base_grasp": plan["T_base_grasp"],
            "duration": plan["duration"],
            "phases": [_phase_entry(phase) for phase in plan["phases"]],
            "refused": plan["refused"],
            "saved": saved,
        }

    def _seen(self, name: str | None) -> Seen:
        """What is in a capture; remembered as long as its file stays the same, so that objects keep their numbers."""
        capture = self._captures.read(name)
        key = (capture.name, capture.stamp)
        if key not in self._known:
            self._known[key] = self._sight.see(capture)
            while len(self._known) > REMEMBERED:
                self._known.popitem(last=False)
        self._known.move_to_end(key)
        return self._known[key]

    def _scene(self, seen: Seen) -> dict[str, Any]:
        result = seen.result
        scores: dict[int, list[float]] = {}
        for grasp in result["grasps"]:
            scores.setdefault(grasp["instance_id"], []).append(grasp["score"])
        return {
            "capture": seen.capture.name,
            "captures": self._captures.names(),
            "age_seconds": round(seen.capture.age, 1),
            "frame_id": result["frame_id"],
            "classes": result["classes"],
            "objects": [_object_entry(item, scores.get(item["instance_id"], [])) for item in result["objects"]],
            "rejected": result["rejected"],
            "left_out": result["left_out"],
            "warnings": result["warnings"],
        }

    def _save(self, plan: dict[str, Any]) -> str | None:
        """Name of the file that the whole plan was written to, one that was not there before."""
        if self._plans is None:
            return None
        names = (f"plan-{number:04d}.json" for number in count(1))
        path = next(path for path in map(self._plans.joinpath, names) if not path.exists())
        write_json(path, plan)
        return path.name


def _check_wish(seen: Seen, object_class: str | None, instance_id: int | None) -> None:
    """Raises InputError for a class that the weights do not know, or an object that is not there."""
    classes, objects = seen.result["classes"], len(seen.result["objects"])
    if object_class is not None and object_class not in classes:
        raise InputError(f"no class {described(object_class)}; the classes are {', '.join(classes)}")
    if instance_id is not None and not 0 <= instance_id < objects:
        raise InputError(f"no object {instance_id}: the scene has {objects}, numbered from 0")


def _rejected(seen: Seen, object_class: str | None, instance_id: int | None) -> dict[str, int]:
    """How many candidates were dropped, by reason: of the objects that are asked for, where that is known."""
    objects = [
        item
        for item in seen.result["objects"]
        if object_class in (None, item["class_name"]) and instance_id in (None, item["instance_id"])
    ]
    if len(objects) == len(seen.result["objects"]) or not all("rejected" in item for item in objects):
        return seen.result["rejected"]
    return {why: sum(item["rejected"][why] for item in objects) for why in seen.result["rejected"]}


def _object_entry(item: dict[str, Any], scores: list[float]) -> dict[str, Any]:
    lower, upper = np.array(item["lower"]), np.array(item["upper"])
    return {
        "instance_id": item["instance_id"],
        "class_name": item["class_name"],
        "class_score": round(item["class_score"], 3),
        "score": round(item["score"], 3),
        "middle": ((lower + upper) / 2).round(4).tolist(),
        "size": (upper - lower).round(4).tolist(),
        "grasps": len(scores),
        "best_score": round(max(scores), 3) if scores else None,
    }


def _grasp_entry(grasp: dict[str, Any]) -> dict[str, Any]:
    pose = np.array(grasp["pose"])
    return {
        "instance_id": grasp["instance_id"],
        "class_name": grasp["class_name"],
        "score": round(grasp["score"], 4),
        "position": pose[:3, 3].round(5).tolist(),
        "quaternion_wxyz": matrix_to_quaternion(pose[:3, :3]).round(6).tolist(),
        "approach": pose[:3, 2].round(5).tolist(),
        "width": round(grasp["width"], 5),
        "opening": round(grasp["opening"], 5),
        "pose": grasp["pose"],
    }


def _phase_entry(phase: dict[str, Any]) -> dict[str, Any]:
    """A phase without the points between its ends, of which there are hundreds."""
    points = phase["joint_trajectory"]["points"]
    kept = ("name", "duration", "opening", "moves_fingers", "carries", "margin", "clearance", "nearest")
    return {
        **{name: phase[name] for name in kept},
        "first_joints": points[0]["positions"],
        "last_joints": points[-1]["positions"],
    }


def _as_text(scene: dict[str, Any]) -> str:
    """A scene for reading."""
    others = [name for name in scene["captures"] if name != scene["capture"]]
    lines = [
        f"{scene['capture']}, written {scene['age_seconds']:.0f} s ago: {len(scene['objects'])} objects, "
        f"in the frame {scene['frame_id']} [m]"
    ]
    if scene["objects"]:
        lines.append("id  class (how sure)  middle x y z  size of what is seen  grasps (best score)")
    for item in scene["objects"]:
        numbers = ["  ".join(f"{value:.3f}" for value in item[name]) for name in ("middle", "size")]
        best = "" if item["best_score"] is None else f" ({item['best_score']:.2f})"
        sure = f"{item['class_name']} ({item['class_score']:.2f})"
        lines.append(f"{item['instance_id']}  {sure}  {'  |  '.join(numbers)}  |  {item['grasps']}{best}")
    if scene["rejected"]:
        lines.append("rejected grasps: " + ", ".join(f"{count} {why}" for why, count in scene["rejected"].items()))
    lines += [f"warning: {warning}" for warning in scene["warnings"]]
    if others:
        lines.append(f"other captures: {', '.join(others)}")
    return "\n".join(lines)


def plans_folder(path: Path | None) -> Path | None:
    """The folder that plans are written to, made if it is not there yet; None for none.

    Raises:
        InputError: there is something else.
    """
    if path is not None:
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"plans cannot be written to {path}: {error.strerror or error}") from error
    return path

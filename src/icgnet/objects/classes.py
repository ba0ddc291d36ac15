"""The object classes, and where the class of an object is written down."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from icgnet.errors import DataError, InputError

DEFINITIONS = {
    "mug": "cup with a handle",
    "box": "cuboid package, also flat or slightly rounded ones: cartons, books, parcels",
    "can": "closed, straight-walled cylinder of food-tin proportions (height at most about 2.2 times the diameter)",
    "bottle": "container with a neck or a shoulder narrower than its body, also spray bottles, and jugs and "
    "tubes with a cap",
    "cylindric": "other bodies of roughly circular cross-section: tall cylinders, markers, torches, cups and glasses "
    "without a handle, jars, rolls",
    "ball": "nearly spherical",
    "bowl": "open dish without a handle, wider than it is deep: bowls, ramekins, plates, trays",
    "tool": "made to be held and worked with: hammer, screwdriver, pliers, scissors, knife, spoon, whisk, clamp, "
    "drill, stapler",
    "other": "everything else: toys, fruit that is not round, pans, shoes, irregular bodies",
}
"""What makes an object one of a class."""
CLASSES = tuple(DEFINITIONS)
"""Class names in the order of the outputs of networks that are trained from now on.

A new class is one more entry, and objects of it. Data and weights name the classes that they were made with.
"""
OTHER = "other"
"""What an object is for weights and data that do not know its class."""
MOST_CLASSES = 1000

DATA_DIR = Path(__file__).parent / "data"
VGN_CLASSES = DATA_DIR / "vgn_classes.json"
VGN_VAL = DATA_DIR / "vgn_val.txt"


def class_index(name: str, classes: Sequence[str] = CLASSES) -> int:
    """The place of a class in a list of classes.

    Raises:
        InputError: the name is not one of them.
    """
    if name not in classes:
        raise InputError(f"unknown object class {name!r}; the classes are {', '.join(classes)}")
    return tuple(classes).index(name)


def known_class(name: str, classes: Sequence[str]) -> str:
    """The class of an object among classes that may be older than its own: itself, or `OTHER` where it is not known.

    Args:
        name: of the object's class.
        classes: that weights or labels know.

    Raises:
        InputError: neither is one of them.
    """
    if name in classes:
        return name
    if OTHER not in classes:
        raise InputError(f"the class {name!r} is not known, nor {OTHER!r}; the classes are {', '.join(classes)}")
    return OTHER


def check_class_list(names: object) -> tuple[str, ...]:
    """The names of classes that a file lists, in their order.

    Raises:
        InputError: not a list of different words.
    """
    if not isinstance(names, list | tuple) or not 0 < len(names) <= MOST_CLASSES:
        raise InputError(f"classes must be a list of 1 to {MOST_CLASSES} names, got {str(names)[:80]}")
    for name in names:
        # They become parts of the names of files.
        if not isinstance(name, str) or not re.fullmatch(r"\w{1,40}", name):
            raise InputError(f"a class must have a name of 1 to 40 letters, digits and _, got {repr(name)[:80]}")
    if len(set(names)) < len(names):
        raise InputError(f"classes must have different names, got {', '.join(names)[:200]}")
    return tuple(names)


def read_classes(path: Path) -> dict[str, str]:
    """Returns object name -> class name from a `classes.json`, the mapping itself or under the key "objects".

    Raises:
        DataError: the file is not such a mapping, or it names an unknown class.
    """
    content = _read(path)
    mapping = content.get("objects", content) if isinstance(content, dict) else content
    return check_classes(mapping, path)


def read_alternatives(path: Path) -> dict[str, str]:
    """Returns object name -> the class that it could have had as well, of a `classes.json`.

    They stand under the key "uncertain", each at the end of a sentence: "a jar, neck 0.82; alternative: bottle".

    Raises:
        DataError: the file cannot be read; an entry is not of an object that has a class, does not end so, or ends with
            an unknown class.
    """
    content = _read(path)
    uncertain = content.get("uncertain", {}) if isinstance(content, dict) and "objects" in content else {}
    if not isinstance(uncertain, dict):
        raise DataError(f'{path}: "uncertain" must map object names to sentences, found {type(uncertain).__name__}')
    alternatives: dict[str, str] = {}
    for name, why in uncertain.items():
        found = re.search(r"alternative: (\w+)$", str(why))
        if found is None:
            raise DataError(f'{path}: uncertain object {name!r} must end with "alternative: CLASS"')
        if name not in content["objects"]:
            raise DataError(f'{path}: uncertain object {name!r} is not among the "objects"')
        if found[1] not in CLASSES:
            raise DataError(
                f"{path}: object {name!r} has the alternative {found[1]!r}; the classes are {', '.join(CLASSES)}"
            )
        alternatives[name] = found[1]
    return alternatives


def check_classes(mapping: object, path: Path) -> dict[str, str]:
    """Returns `mapping` when it maps names to known classes.

    Raises:
        DataError: it does not; the message names the file and the first wrong entry.
    """
    if not isinstance(mapping, dict):
        raise DataError(f"{path}: expected a mapping from object name to class, found {type(mapping).__name__}")
    for name, class_name in mapping.items():
        if class_name not in CLASSES:
            raise DataError(f"{path}: object {name!r} has class {class_name!r}; the classes are {', '.join(CLASSES)}")
    return {str(name): class_name for name, class_name in mapping.items()}


def _read(path: Path) -> Any:
    try:
        return json.loads(path.read_text())
    except (OSError, json.JSONDecodeError) as error:
        raise DataError(f"cannot read the object classes in {path}: {error}") from error

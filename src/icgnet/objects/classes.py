"""The seven object classes, and where the class of an object is written down."""

import json
import re
from pathlib import Path
from typing import Any

from icgnet.errors import DataError, InputError

CLASSES = ("mug", "box", "can", "bottle", "cylindric", "ball", "other")
"""Class names in the order of the network's outputs (the paper's labels, spelled out)."""

DATA_DIR = Path(__file__).parent / "data"
VGN_CLASSES = DATA_DIR / "vgn_classes.json"
VGN_VAL = DATA_DIR / "vgn_val.txt"


def class_index(name: str) -> int:
    """Returns the network's index of a class name.

    Raises:
        InputError: the name is not one of `CLASSES`.
    """
    if name not in CLASSES:
        raise InputError(f"unknown object class {name!r}; the classes are {', '.join(CLASSES)}")
    return CLASSES.index(name)


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

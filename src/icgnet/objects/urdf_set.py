"""Object sets in the VGN layout: `packed/{train,test}` and `pile/{train,test}` with URDF files."""

from collections import Counter
from pathlib import Path

from icgnet.errors import DataError
from icgnet.objects.base import FileObjectSet, ObjectFile, doubles
from icgnet.objects.classes import VGN_CLASSES, VGN_VAL, read_alternatives, read_classes
from icgnet.objects.kinds import CUBE_KINDS, WIDE_KINDS, Kind, Split
from icgnet.objects.model import ObjectModel
from icgnet.objects.urdf import read_urdf_object


class UrdfObjectSet(FileObjectSet):
    """Objects in the VGN layout: `packed/{train,test}/*.urdf` and `pile/{train,test}/*.urdf`, keys "pile/name".

    Classes come from `classes.json` in the folder and held-out names from `val.txt`; for the VGN objects
    themselves both ship with this package, and those in the folder do not count. Objects without a class are "other". A
    key that is in train and in test is left out of both.

    Raises:
        DataError: no URDFs, or broken lists.
    """

    def __init__(self, directory: Path) -> None:
        paths = urdf_paths(directory)
        if not paths:
            raise DataError(f"{directory}: no packed/{{train,test}}/*.urdf or pile/{{train,test}}/*.urdf found")
        is_vgn = {path.stem for path in paths} <= read_classes(VGN_CLASSES).keys()
        classes, alternatives = _classes(directory, is_vgn)
        held_out = _held_out(directory, is_vgn)
        files: dict[str, ObjectFile] = {}
        copies = Counter(object_key(path) for path in paths)
        for path in paths:
            if copies[object_key(path)] > 1:
                continue
            kind: Kind = "packed" if path.parent.parent.name == "packed" else "pile"
            split: Split = "test" if path.parent.name == "test" else "val" if path.stem in held_out else "train"
            name = path.stem
            files[object_key(path)] = ObjectFile(
                path, classes.get(name, "other"), (kind, *WIDE_KINDS), split, alternatives.get(name)
            )
        super().__init__("vgn" if is_vgn else directory.resolve().name, files, left_out=doubles(copies))

    def _load(self, key: str) -> ObjectModel:
        file = self.file(key)
        return read_urdf_object(file.path, key, file.class_name)


def object_key(path: Path) -> str:
    """Returns the key of a URDF in the VGN layout, such as "pile/cup"."""
    return f"{path.parent.parent.name}/{path.stem}"


def urdf_paths(directory: Path) -> list[Path]:
    """Returns the URDF files of a folder in the VGN layout, sorted."""
    return sorted(
        path for kind in CUBE_KINDS for split in ("train", "test") for path in directory.glob(f"{kind}/{split}/*.urdf")
    )


def _classes(directory: Path, is_vgn: bool) -> tuple[dict[str, str], dict[str, str]]:
    """Classes by name, and those that some of the objects could have had as well."""
    path = VGN_CLASSES if is_vgn else directory / "classes.json"
    if not path.is_file():
        return {}, {}
    return read_classes(path), read_alternatives(path)


def _held_out(directory: Path, is_vgn: bool) -> set[str]:
    path = VGN_VAL if is_vgn else directory / "val.txt"
    return set(path.read_text().split()) if path.is_file() else set()


def is_vgn_layout(directory: Path) -> bool:
    """Returns whether a folder has the subfolders of the VGN layout."""
    return any((directory / kind).is_dir() for kind in CUBE_KINDS)

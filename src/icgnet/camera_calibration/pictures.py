"""Grey pictures from a folder."""

from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from icgnet.errors import DataError, InputError

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


def picture_names(folder: Path) -> tuple[str, ...]:
    """Names of the pictures in a folder, in order.

    Raises:
        InputError: no such folder, or no picture in it.
    """
    if not folder.is_dir():
        raise InputError(f"no such folder: {folder}")
    names = sorted(each.name for each in folder.iterdir() if each.suffix.lower() in SUFFIXES)
    if not names:
        raise InputError(f"{folder} holds no picture; known are {', '.join(SUFFIXES)}")
    return tuple(names)


def read_grey(path: Path) -> UInt8[np.ndarray, "h w"]:
    """A picture in grey; one of more than 8 bits (infrared) is scaled to its brightest pixel.

    Raises:
        DataError: it cannot be read.
    """
    try:
        with Image.open(path) as image:
            if image.mode not in ("I", "F") and not image.mode.startswith("I;16"):
                return np.asarray(image.convert("L"))
            values = np.nan_to_num(np.asarray(image, np.float64), posinf=0.0, neginf=0.0)
    except Exception as error:  # there is no end to what a broken picture can raise
        raise DataError(
            f"cannot read {path}: {(str(error).splitlines() or [type(error).__name__])[0][:200]}"
        ) from error
    return np.clip(255.0 * values / max(float(values.max()), 1.0), 0.0, 255.0).astype(np.uint8)

"""Fixtures that more than one folder of tests needs."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# Times vary with what else the machine does, so no example fails for being slow.
settings.register_profile("icgnet", deadline=None, max_examples=40)
settings.load_profile("icgnet")


@pytest.fixture(scope="session")
def vgn_objects() -> Path:
    """Folder of the VGN object set; tests that need it are skipped where it is absent."""
    folder = os.environ.get("ICGNET_OBJECTS")
    if not folder or not (Path(folder) / "packed" / "train").is_dir():
        pytest.skip("needs the VGN object set: set ICGNET_OBJECTS to the folder with packed/ and pile/")
    return Path(folder)

"""Whoever imports this is skipped where the package of icgnet[calibrate] is not installed."""

import pytest

from icgnet.errors import MissingExtraError

pytest.importorskip("icgnet.camera_calibration.libraries", reason="needs icgnet[calibrate]", exc_type=MissingExtraError)

"""Whoever imports this is skipped where the packages of icgnet[arm] are not installed."""

import pytest

from icgnet.errors import MissingExtraError

pytest.importorskip("icgnet.arm.libraries", reason="needs icgnet[arm]", exc_type=MissingExtraError)

"""What papers print about methods on scenes like ours; published.yaml holds it and names the sources."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

PUBLISHED: Mapping[str, Any] = yaml.safe_load((Path(__file__).parent / "published.yaml").read_text(encoding="utf-8"))
"""Under rates, targets, shapes, times, captures and arms: cells in the order of the columns of the benchmark's page."""

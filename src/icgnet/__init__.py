"""One depth image of a cluttered table in; instances, classes, complete shapes and ranked grasps out."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from icgnet.predictor import Predictor as Predictor

__version__ = "0.2.0"
__all__ = ["Predictor", "__version__"]


def __getattr__(name: str) -> Any:
    """Imports `Predictor` on first use, so that `import icgnet` does not load torch."""
    if name == "Predictor":
        from icgnet.predictor import Predictor

        return Predictor
    raise AttributeError(f"module 'icgnet' has no attribute {name!r}")

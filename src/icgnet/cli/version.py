"""`icgnet version`."""

from dataclasses import dataclass

from icgnet import __version__


@dataclass(frozen=True)
class Version:
    """Print the version."""

    def run(self) -> None:
        """Prints it."""
        print(f"icgnet {__version__}")

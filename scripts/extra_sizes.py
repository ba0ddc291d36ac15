"""Bytes that icgnet and each of its extras take in site-packages, of the environment that this runs in.

python scripts/extra_sizes.py [EXTRA ...]

Counted are the files that the installed distributions list, each extra with all that it needs beyond what icgnet needs
without it. Extras that are not installed whole are said to be so.
"""

import argparse
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PROJECT = "icgnet"


def needed(name: str, extras: frozenset[str], seen: dict[str, frozenset[str]], missing: set[str]) -> None:
    """Adds a distribution and all that it needs to `seen`, and what is not installed to `missing`."""
    name = canonicalize_name(name)
    if name in seen and extras <= seen[name]:
        return
    try:
        distribution = metadata.distribution(name)
    except metadata.PackageNotFoundError:
        missing.add(name)
        return
    seen[name] = extras | seen.get(name, frozenset())
    for text in distribution.requires or ():
        each = Requirement(text)
        if each.marker is None or any(each.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            needed(each.name, frozenset(each.extras), seen, missing)


def size_of(name: str) -> int:
    """Bytes of the files of a distribution that are there."""
    files = [Path(str(file.locate())) for file in metadata.distribution(name).files or ()]
    return sum(file.stat().st_size for file in files if file.is_file())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("extras", nargs="*")
    given = parser.parse_args().extras
    extras = given or sorted(metadata.metadata(PROJECT).get_all("Provides-Extra") or ())
    base: dict[str, frozenset[str]] = {}
    needed(PROJECT, frozenset(), base, set())
    torch = [name for name in base if name == "torch" or name.startswith(("nvidia-", "cuda-", "triton"))]
    rest = sum(size_of(name) for name in base if name not in (*torch, PROJECT))
    print(f"{'icgnet':12} {size_of(PROJECT) / 1e6:8.1f} MB")
    print(f"{'torch':12} {sum(map(size_of, torch)) / 1e6:8.1f} MB  ({metadata.version('torch')})")
    print(f"{'the rest':12} {rest / 1e6:8.1f} MB  ({len(base) - len(torch) - 1} packages)")
    for extra in extras:
        seen, missing = {}, set()
        needed(PROJECT, frozenset({extra}), seen, missing)
        more = sorted(set(seen) - set(base))
        note = f"  not whole, missing: {', '.join(sorted(missing))}" if missing else ""
        print(f"{extra:12} {sum(map(size_of, more)) / 1e6:8.1f} MB  ({len(more)} packages){note}")


if __name__ == "__main__":
    main()

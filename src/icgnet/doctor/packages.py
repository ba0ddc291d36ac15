"""Which packages are installed, by what the installed icgnet itself says that it needs."""

from collections.abc import Iterator
from importlib import metadata

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from icgnet.doctor.finding import Finding

PROJECT = "icgnet"
FOR_DEVELOPERS = "dev"


def package_findings() -> list[Finding]:
    """The packages that icgnet always needs, in one line, and one line for each extra."""
    try:
        distribution = icgnet_itself()
    except metadata.PackageNotFoundError:
        return [Finding("packages", "not known: icgnet itself is not installed, it runs from its sources")]
    needed = [Requirement(text) for text in distribution.requires or ()]
    wrong = list(_wrong(needed, ""))
    always = [each for each in needed if each.marker is None or each.marker.evaluate({"extra": ""})]
    found = [
        Finding("packages", "; ".join(wrong), True, f"pip install {PROJECT}")
        if wrong
        else Finding("packages", f"all {len(always)} are there: {', '.join(map(_with_version, always))}")
    ]
    for extra in sorted(distribution.metadata.get_all("Provides-Extra") or ()):
        if extra == FOR_DEVELOPERS:
            continue
        missing = list(_wrong(needed, extra))
        value, hint = ("; ".join(missing), f'pip install "{PROJECT}[{extra}]"') if missing else ("there", "")
        found.append(Finding(f"extra {extra}", value, hint=hint))
    return found


def icgnet_itself() -> metadata.Distribution:
    """What pip wrote down about the installed icgnet.

    Raises:
        PackageNotFoundError: it is not installed.
    """
    return metadata.distribution(PROJECT)


def _wrong(needed: list[Requirement], extra: str) -> Iterator[str]:
    """What is missing or too old among the packages of an extra, or of no extra."""
    for each in needed:
        only_here = each.marker is not None and not each.marker.evaluate({"extra": ""})
        if only_here != bool(extra) or (each.marker is not None and not each.marker.evaluate({"extra": extra})):
            continue
        version = _version(each)
        if version is None:
            yield f"{each.name} is missing"
        elif not each.specifier.contains(version, prereleases=True):
            yield f"{each.name} {version} is not {each.specifier}"


def _version(requirement: Requirement) -> str | None:
    try:
        return metadata.version(canonicalize_name(requirement.name))
    except metadata.PackageNotFoundError:
        return None


def _with_version(requirement: Requirement) -> str:
    return f"{requirement.name} {_version(requirement)}"

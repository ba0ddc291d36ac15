"""Builds the sdist and the wheel, looks at what is in them, and tries the wheel in a new environment of each Python.

python scripts/check_packages.py [PYTHON ...] [--out dist] [--work FOLDER] [--only-build]

A Python is a path or a name on the PATH; without any, all of python3.11 to python3.14 that are found (also those of
pyenv) are tried, and the others are named as not tried. The wheel is installed with constraints.txt into a new virtual
environment, outside of the sources; then `icgnet --version`, `icgnet doctor` and `icgnet demo` must succeed, and the
result of the demo must hold objects and grasps. Needs the package `build`. The environments are removed afterwards.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
LARGEST_WHEEL = 15e6
"""The weights are 7 MB; much more is a mistake [bytes]."""
ESSENTIAL = (
    *("icgnet/weights/default.safetensors", "icgnet/captures/demo.npz", "icgnet/captures/table.npz", "icgnet/py.typed"),
    *("icgnet/arm/arms/fr3.urdf", "icgnet/grasping/grippers/franka.yaml", "icgnet/objects/data/vgn_classes.json"),
)
KINDS = (".py", ".typed", ".yaml", ".json", ".txt", ".urdf", ".npz", ".safetensors", ".html", ".js", ".css")
"""Of files in the package."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pythons", nargs="*")
    parser.add_argument("--out", type=Path, default=ROOT / "dist")
    parser.add_argument("--work", type=Path, help="where environments are made; a temporary folder if not given")
    parser.add_argument("--only-build", action="store_true")
    given = parser.parse_args()
    sdist, wheel = build(given.out)
    problems = [*wheel_problems(wheel), *sdist_problems(sdist)]
    print(f"{sdist.name} {sdist.stat().st_size / 1e6:.1f} MB, {wheel.name} {wheel.stat().st_size / 1e6:.1f} MB")
    if not given.only_build:
        pythons = [shutil.which(name) or name for name in given.pythons] or found_pythons()
        for python in pythons:
            problems += tried(python, wheel, given.work)
    for problem in problems:
        print(f"WRONG: {problem}")
    return int(bool(problems))


def build(out: Path) -> tuple[Path, Path]:
    """The sdist of the committed files, and the wheel that is built from that sdist."""
    with tempfile.TemporaryDirectory() as folder:
        source, fresh = Path(folder) / "source", Path(folder) / "dist"
        source.mkdir()
        # What lies about in the working tree (old builds, data) does not get in.
        archive = subprocess.run(["git", "-C", ROOT, "archive", "HEAD"], capture_output=True, check=True).stdout
        subprocess.run(["tar", "-x", "-C", source], input=archive, check=True)
        subprocess.run(
            [sys.executable, "-m", "build", "--outdir", fresh, source], check=True, stdout=subprocess.DEVNULL
        )
        out.mkdir(parents=True, exist_ok=True)
        (sdist,), (wheel,) = fresh.glob("*.tar.gz"), fresh.glob("*.whl")
        return Path(shutil.copy(sdist, out)), Path(shutil.copy(wheel, out))


def wheel_problems(wheel: Path) -> list[str]:
    """What is in a wheel that should not be, and what is missing."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    about = f"{'-'.join(wheel.name.split('-')[:2])}.dist-info/"
    strangers = [name for name in names if not name.startswith(("icgnet/", about))]
    kinds = [name for name in names if name.startswith("icgnet/") and not name.endswith(KINDS)]
    problems = [f"{wheel.name} holds {name}" for name in (*strangers, *kinds)]
    problems += [f"{wheel.name} lacks {name}" for name in ESSENTIAL if name not in names]
    if wheel.stat().st_size > LARGEST_WHEEL:
        problems.append(f"{wheel.name} has {wheel.stat().st_size} bytes")
    command = ["git", "-C", ROOT, "ls-tree", "-r", "--name-only", "HEAD", "src/icgnet"]
    sources = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    return problems + [f"{wheel.name} lacks {name}" for name in sources if name.removeprefix("src/") not in names]


def sdist_problems(sdist: Path) -> list[str]:
    """What an sdist lacks to be built and read."""
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    return [f"{sdist.name} lacks {name}" for name in ("pyproject.toml", "README.md", "LICENSE") if name not in names]


def found_pythons() -> list[str]:
    """One Python of each version of `VERSIONS` that this machine has; the others are named."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    found = []
    for version in VERSIONS:
        own = sorted(str(path) for path in pyenv.glob(f"{version}.*/bin/python"))
        python = own[-1] if own else shutil.which(f"python{version}")
        if python is None:
            print(f"not tried: Python {version} is not on this machine")
        else:
            found.append(python)
    return found


def tried(python: str, wheel: Path, work: Path | None) -> list[str]:
    """What goes wrong with a wheel in a new environment of a Python, which is removed again."""
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    with tempfile.TemporaryDirectory(dir=work) as folder:
        place, times = Path(folder), {}
        bin_folder = place / "venv" / "bin"
        pip = [bin_folder / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        steps: dict[str, list[str | Path]] = {
            "environment": [python, "-m", "venv", place / "venv"],
            "install": [*pip, "-c", ROOT / "constraints.txt", wheel.resolve()],
            "version": [bin_folder / "icgnet", "--version"],
            "doctor": [bin_folder / "icgnet", "doctor"],
            "demo": [bin_folder / "icgnet", "demo"],
        }
        for name, command in steps.items():
            begun = time.monotonic()
            done = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, check=False)
            times[name] = time.monotonic() - begun
            if done.returncode:
                last = (done.stderr.strip() or done.stdout.strip()).splitlines()[-1:]
                return [f"{python}: {name} ends with {done.returncode}: {' '.join(last)}"]
        problems = []
        for out in ("demo_output", "demo_output_table"):
            result = json.loads((place / out / "result.json").read_text())
            if not result["objects"] or not result["grasps"]:
                problems.append(f"{python}: {out} has {len(result['objects'])} objects, {len(result['grasps'])} grasps")
        print(f"{python}: " + ", ".join(f"{name} {seconds:.0f} s" for name, seconds in times.items()))
        return problems


if __name__ == "__main__":
    sys.exit(main())

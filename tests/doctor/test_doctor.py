"""`icgnet doctor`: what it tells of a whole installation and of broken ones."""

from importlib import metadata
from pathlib import Path

import pytest

from icgnet.cli.demo import FOLDER
from icgnet.cli.main import main
from icgnet.doctor import packages, works
from icgnet.doctor.finding import Finding
from icgnet.doctor.packages import package_findings
from icgnet.doctor.works import prediction_finding, weights_finding
from icgnet.network.weights import save_weights
from icgnet.network.weights_header import DEFAULT_WEIGHTS, read_header
from tabletop_scenes import tiny_network

VERSION = metadata.version("numpy")


class Installed:
    """A distribution of icgnet that needs what the test says."""

    def __init__(self, *requires: str, extras: tuple[str, ...] = ()) -> None:
        self.requires = list(requires)
        self.metadata = type("Metadata", (), {"get_all": lambda _, name: list(extras)})()


@pytest.fixture
def installed(monkeypatch):
    def install(*requires: str, extras: tuple[str, ...] = ()) -> list[Finding]:
        monkeypatch.setattr(packages, "icgnet_itself", lambda: Installed(*requires, extras=extras))
        return package_findings()

    return install


def test_what_is_needed_and_there_is_told_with_its_version(installed):
    (found,) = installed("numpy>=1.26", "scipy")
    assert not found.is_broken
    assert found.value == f"all 2 are there: numpy {metadata.version('numpy')}, scipy {metadata.version('scipy')}"


@pytest.mark.parametrize(
    ("needs", "said"),
    [
        ("none-such-package>=1", "none-such-package is missing"),
        ("numpy<1", f"numpy {metadata.version('numpy')} is not <1"),
    ],
)
def test_what_is_missing_or_of_another_version_is_broken(installed, needs, said):
    (found,) = installed("scipy", needs)
    assert (found.is_broken, found.value, found.hint) == (True, said, "pip install icgnet")


def test_an_extra_is_there_or_told_how_to_install_and_is_never_broken(installed):
    found = installed(
        "numpy",
        'scipy; extra == "whole"',
        'none-such-package; extra == "poor"',
        'other-package; extra == "elsewhere" and python_version < "3"',
        'none-such-tool; extra == "dev"',
        extras=("whole", "poor", "elsewhere", "dev"),
    )
    told = {each.name: (each.value, each.hint) for each in found[1:]}
    assert told == {
        "extra whole": ("there", ""),
        "extra poor": ("none-such-package is missing", 'pip install "icgnet[poor]"'),
        "extra elsewhere": ("there", ""),
    }
    assert not any(each.is_broken for each in found)


def test_sources_that_are_not_installed_are_said_to_be_so(monkeypatch):
    monkeypatch.setattr(packages, "PROJECT", "none-such-package")
    (found,) = package_findings()
    assert "icgnet itself is not installed" in found.value
    assert not found.is_broken


def test_the_weights_are_told_by_checksum_and_classes(tmp_path):
    header = read_header(DEFAULT_WEIGHTS)
    found = weights_finding()
    assert f"sha256 {header.sha256[:8]}" in found.value
    assert ", ".join(header.config.classes) in found.value
    (tmp_path / "broken.safetensors").write_bytes(DEFAULT_WEIGHTS.read_bytes()[:1000])
    broken = weights_finding(tmp_path / "broken.safetensors")
    assert broken.is_broken
    assert "not a readable safetensors file" in broken.value


def test_weights_that_find_nothing_or_cannot_be_loaded_are_broken(tmp_path):
    path = tmp_path / "tiny.safetensors"
    save_weights(path, tiny_network(), {})
    content = bytearray(path.read_bytes())
    content[-1] ^= 0xFF  # of the last number of the last tensor
    path.write_bytes(content)
    found = prediction_finding(FOLDER / "demo.npz", path, repeat=1)
    assert found.is_broken
    assert found.value.startswith("failed: DataError")


@pytest.mark.parametrize(
    ("measured", "is_broken", "hint"),
    [
        ((500.0, 1.9, 5, 40), False, ""),
        ((9000.0, 0.99, 5, 40), False, "slow: more --threads, or a processor with AVX2 or AVX-512"),
        ((9000.0, 0.1, 5, 40), False, "slow: other programs hold the processor, 10% was left"),
        ((500.0, 1.9, 0, 0), True, "the weights do not know the bundled scene: are they the right ones?"),
    ],
)
def test_the_time_is_judged_by_what_is_usual(monkeypatch, measured, is_broken, hint):
    monkeypatch.setattr(works, "_timed", lambda *given: measured)
    found = prediction_finding(Path("demo.npz"))
    assert (found.is_broken, found.hint) == (is_broken, hint)
    assert f"{measured[2]} objects, {measured[3]} grasps in {measured[0]:.0f} ms (usual: about 700 ms" in found.value


@pytest.mark.slow
def test_this_installation_works(capsys):
    assert main(["doctor", "--repeat", "1"]) == 0
    out = capsys.readouterr().out
    for name in ("icgnet", "python", "packages", "processor", "threads", "precision", "weights", "prediction"):
        assert f"\n{name} " in f"\n{out}"
    assert out.endswith("nothing is broken\n")


def test_a_broken_installation_is_one_line_and_exit_code_2(capsys, tmp_path):
    assert main(["doctor", "--weights", str(tmp_path / "none.safetensors")]) == 2
    told = capsys.readouterr()
    assert "BROKEN" in told.out
    assert "prediction" not in told.out
    assert told.err == "error: this installation is broken: weights\n"


@pytest.mark.parametrize(
    ("arguments", "said"), [(["--threads", "0"], "threads must be"), (["--repeat", "0"], "repeat must")]
)
def test_numbers_out_of_range_are_one_line(arguments, said, capsys):
    assert main(["doctor", *arguments]) == 2
    assert said in capsys.readouterr().err

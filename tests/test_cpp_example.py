"""The example in C++ is compiled and asks a service."""

import shutil
import subprocess
from pathlib import Path

import pytest

from http_service import PINHOLE, TOKEN, depth_png, running, tiny_predictor

SOURCE = Path(__file__).parent.parent / "examples" / "cpp" / "predict.cpp"
INCLUDES = "#include <curl/curl.h>\nint main() { curl_global_init(CURL_GLOBAL_DEFAULT); }\n"


@pytest.fixture(scope="module")
def program(tmp_path_factory) -> Path:
    compiler = next(filter(None, map(shutil.which, ("c++", "g++", "clang++"))), None)
    if compiler is None:
        pytest.skip("needs a C++ compiler")
    folder = tmp_path_factory.mktemp("cpp")
    (folder / "probe.cpp").write_text(INCLUDES)
    probe = [compiler, str(folder / "probe.cpp"), "-lcurl", "-o", str(folder / "probe")]
    if subprocess.run(probe, capture_output=True, check=False).returncode:
        pytest.skip("needs libcurl with its headers (Debian: libcurl4-openssl-dev)")
    warnings = ("-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
    subprocess.run([compiler, *warnings, str(SOURCE), "-lcurl", "-o", str(folder / "predict")], check=True)
    (folder / "depth.png").write_bytes(depth_png())
    return folder / "predict"


def run(program: Path, url: str, scale: str = "1000", **environment: str) -> subprocess.CompletedProcess:
    command = [str(program), url, str(program.with_name("depth.png")), PINHOLE, scale]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, env=environment)


@pytest.mark.slow
def test_it_prints_the_best_grasp(program):
    with running(tiny_predictor(), TOKEN) as (url, _, _):
        done = run(program, url, ICGNET_TOKEN=TOKEN)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].startswith("best grasp: ")
    assert [len(line.split()) for line in lines[1:]] == [4] * 4
    assert lines[-1].split() == ["0.00000", "0.00000", "0.00000", "1.00000"]


@pytest.mark.slow
def test_it_prints_what_the_service_refuses(program):
    with running(tiny_predictor()) as (url, _, _):
        done = run(program, url, scale="1")
    assert done.returncode == 1
    assert "422" in done.stderr
    assert "which looks like millimetres" in done.stderr
    assert "no answer" in run(program, "http://127.0.0.1:9").stderr

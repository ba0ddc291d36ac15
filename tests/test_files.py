import errno
import json
import os
import subprocess
import sys

import pytest

from icgnet.errors import DataError
from icgnet.files import new_file, remove_partial_files, write_json, write_text

LITTLE_DISK = """
import resource, sys
from pathlib import Path
from icgnet.files import new_file
from icgnet.errors import DataError
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    with new_file(Path(sys.argv[1])) as file:
        file.write(b"x" * 5000)
except DataError as error:
    print(error)
"""

DEATH = """
import os, signal, sys
from pathlib import Path
from icgnet.files import new_file
with new_file(Path(sys.argv[1])) as file:
    file.write(b"half")
    file.flush()
    os.kill(os.getpid(), signal.SIGKILL)
"""


def run(code, path):
    return subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True).stdout


def test_a_file_takes_its_place_when_the_block_ends(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    with new_file(path) as file:
        file.write(b"new")
        assert path.read_bytes() == b"old"
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(os.name == "nt", reason="POSIX limits")
def test_a_system_that_cannot_write_more_leaves_the_old_file_and_no_half_one(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    assert f"{path}: cannot write: File too large" in run(LITTLE_DISK, path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_death_in_the_middle_leaves_no_half_file_under_the_final_name(tmp_path):
    path = tmp_path / "file"
    run(DEATH, path)
    [partial] = tmp_path.iterdir()
    assert partial.suffix == ".partial"
    remove_partial_files(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_an_error_of_the_system_says_what_it_is(tmp_path):
    with pytest.raises(DataError, match=r"file: cannot write: No space left on device"), new_file(tmp_path / "file"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_json_comes_back(tmp_path):
    write_json(tmp_path / "new" / "file.json", {"a": [1, 2]})
    assert json.loads((tmp_path / "new" / "file.json").read_text()) == {"a": [1, 2]}


def test_numbers_that_are_not_finite_become_null(tmp_path):
    write_json(tmp_path / "a.json", {"rate": {"mean": float("nan")}, "rows": [float("inf"), 1.5, "text"]})
    values = json.loads((tmp_path / "a.json").read_text(), parse_constant=lambda name: pytest.fail(name))
    assert values == {"rate": {"mean": None}, "rows": [None, 1.5, "text"]}


def test_two_that_write_the_same_file_do_not_meet(tmp_path):
    path = tmp_path / "file"
    with new_file(path) as first:
        first.write(b"first")
        with new_file(path) as second:
            second.write(b"second")
        assert path.read_bytes() == b"second"
    assert path.read_bytes() == b"first"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_is_a_file_is_one_clear_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="cannot write: Not a directory"):
        write_text(tmp_path / "file" / "a.json", "{}")


@pytest.mark.skipif(os.name == "nt", reason="POSIX devices")
def test_text_goes_through_a_device_and_does_not_take_its_place(tmp_path):
    link = tmp_path / "null"
    link.symlink_to("/dev/null")
    write_text(link, "text")
    assert link.is_symlink()
    assert list(tmp_path.iterdir()) == [link]

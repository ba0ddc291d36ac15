"""Output folders that appear whole or not at all."""

import errno
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from icgnet.errors import DataError, InputError
from icgnet.output_folder import output_folder

MARKER = "result.json"


def write(path, text, overwrite=False):
    with output_folder(path, MARKER, overwrite) as folder:
        (folder / MARKER).write_text(text)


def write_half(path):
    with output_folder(path, MARKER) as folder:
        (folder / MARKER).write_text("half")
        raise RuntimeError


def test_a_finished_folder_is_all_that_is_left(tmp_path):
    write(tmp_path / "a" / "out", "1")
    assert [item.name for item in (tmp_path / "a").iterdir()] == ["out"]
    assert (tmp_path / "a" / "out" / MARKER).read_text() == "1"


def test_a_failure_leaves_nothing(tmp_path):
    with pytest.raises(RuntimeError):
        write_half(tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_failure_leaves_the_earlier_folder_as_it_was(tmp_path):
    write(tmp_path / "out", "earlier")
    with pytest.raises(RuntimeError):
        write_half(tmp_path / "out")
    assert (tmp_path / "out" / MARKER).read_text() == "earlier"
    assert [item.name for item in tmp_path.iterdir()] == ["out"]


def test_a_folder_of_ours_is_replaced_whole(tmp_path):
    write(tmp_path / "out", "earlier")
    (tmp_path / "out" / "old.ply").write_text("")
    write(tmp_path / "out", "later")
    assert [item.name for item in (tmp_path / "out").iterdir()] == [MARKER]


def test_an_empty_folder_is_replaced(tmp_path):
    (tmp_path / "out").mkdir()
    write(tmp_path / "out", "1")
    assert (tmp_path / "out" / MARKER).exists()


def test_a_folder_of_somebody_else_is_kept_unless_overwriting_is_asked_for(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("")
    with pytest.raises(InputError, match="--overwrite"):
        write(out, "1")
    assert (out / "thesis.tex").exists()
    write(out, "1", overwrite=True)
    assert [item.name for item in out.iterdir()] == [MARKER]


def test_a_file_in_the_way_is_never_replaced(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match="it is a file"):
        write(tmp_path / "out", "1", overwrite=True)


KILLED = """
import os, signal, sys
from pathlib import Path
from icgnet import output_folder
if sys.argv[2] == "between":
    output_folder._bring_back = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
    rename = Path.rename
    def fail(self, target):
        if self.name == "new":
            raise OSError
        return rename(self, target)
    Path.rename = fail
with output_folder.output_folder(Path(sys.argv[1]), "result.json") as folder:
    (folder / "result.json").write_text("killed")
    if sys.argv[2] == "writing":
        os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize("moment", ["writing", "between"])
def test_what_a_killed_process_left_is_cleared_away_and_the_earlier_folder_is_kept(tmp_path, moment):
    out = tmp_path / "out"
    write(out, "earlier")
    subprocess.run([sys.executable, "-c", KILLED, str(out), moment], check=False)
    assert len(list(tmp_path.iterdir())) == (2 if moment == "writing" else 1)
    with pytest.raises(RuntimeError):
        write_half(out)
    assert (out / MARKER).read_text() == "earlier"
    assert [item.name for item in tmp_path.iterdir()] == ["out"]


def test_two_that_write_at_once_leave_the_folder_of_the_last(tmp_path):
    with output_folder(tmp_path / "out", MARKER) as first:
        (first / MARKER).write_text("first")
        write(tmp_path / "out", "second")
        assert (first / MARKER).is_file()
    assert (tmp_path / "out" / MARKER).read_text() == "first"
    assert [item.name for item in tmp_path.iterdir()] == ["out"]


def test_a_foreign_folder_that_appears_meanwhile_is_kept(tmp_path):
    out = tmp_path / "out"
    with pytest.raises(InputError, match="holds other files"), output_folder(out, MARKER):
        out.mkdir()
        (out / "thesis.tex").write_text("")
    assert [item.name for item in out.iterdir()] == ["thesis.tex"]
    assert [item.name for item in tmp_path.iterdir()] == ["out"]


def test_the_earlier_folder_comes_back_when_the_new_one_cannot_take_its_place(tmp_path, monkeypatch):
    out = tmp_path / "out"
    write(out, "earlier")
    rename = Path.rename

    def fail(self, target):
        if self.name == "new":
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", fail)
    with pytest.raises(DataError, match=r"out: cannot write: Input/output error"):
        write(out, "later")
    assert (out / MARKER).read_text() == "earlier"
    assert [item.name for item in tmp_path.iterdir()] == ["out"]


def test_a_full_disk_names_the_folder(tmp_path):
    with pytest.raises(DataError, match=r"out: cannot write: No space left"), output_folder(tmp_path / "out", MARKER):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_missing_elsewhere_is_not_blamed_on_the_folder(tmp_path):
    with pytest.raises(FileNotFoundError, match="input"), output_folder(tmp_path / "a" / "out", MARKER):
        (tmp_path / "input").read_text()
    assert list((tmp_path / "a").iterdir()) == []


def test_many_that_write_at_once_all_succeed_and_leave_one_whole_folder(tmp_path):
    def save(name):
        for _ in range(10):
            write(tmp_path / "out", str(name))

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(save, range(4)))
    assert (tmp_path / "out" / MARKER).read_text() in "0123"
    assert [item.name for item in tmp_path.iterdir()] == ["out"]

"""Output folders that appear whole or not at all."""

import pytest

from icgnet.errors import InputError
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

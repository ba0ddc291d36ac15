import shutil
import subprocess

import pytest

from icgnet.benchmark.record import source_commit


def git(folder, *command: str) -> None:
    who = ("-c", "user.name=Somebody", "-c", "user.email=somebody@example.org")
    subprocess.run(["git", "-C", str(folder), *who, *command], check=True, capture_output=True)


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
def test_the_commit_is_named_only_if_it_holds_the_package(tmp_path):
    """An environment in a user's repository is not tracked there."""
    own, installed = tmp_path / "own.py", tmp_path / "venv" / "package.py"
    installed.parent.mkdir()
    for file in (own, installed):
        file.write_text("")
    assert source_commit(own) is None, "there is no repository yet"
    git(tmp_path, "init")
    git(tmp_path, "add", "own.py")
    git(tmp_path, "commit", "-m", "first")
    commit = source_commit(own)
    assert commit is not None
    assert len(commit) == 12
    assert source_commit(installed) is None
    own.write_text("changed = True")
    assert source_commit(own) == f"{commit}-dirty"

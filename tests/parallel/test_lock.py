import json
import os
import platform
import signal
import subprocess
import sys

import pytest

from icgnet.errors import DataError
from icgnet.parallel.lock import LOCK, OWNER, locked

HOLD = """
import sys, time
from pathlib import Path
from icgnet.parallel.lock import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_second_run_is_refused_and_told_who_holds_the_folder(tmp_path):
    with locked(tmp_path), pytest.raises(DataError) as caught, locked(tmp_path):
        pass
    assert f"{tmp_path}: process {os.getpid()} on {platform.node()}" in str(caught.value)


def test_a_lock_is_free_after_its_block_also_when_that_failed(tmp_path):
    with pytest.raises(KeyError), locked(tmp_path):
        raise KeyError
    with locked(tmp_path):
        pass
    assert not (tmp_path / OWNER).exists()


def test_folders_are_locked_one_by_one(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    with locked(tmp_path / "a"), locked(tmp_path / "b"):
        pass


@pytest.mark.parametrize("text", ["", "[]", '{"pid": 1}'])
def test_an_owner_that_cannot_be_read_is_another_process(tmp_path, text):
    with locked(tmp_path):
        (tmp_path / OWNER).write_text(text)
        with pytest.raises(DataError, match="another process is writing"), locked(tmp_path):
            pass


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_the_lock_of_a_killed_process_is_taken_over(tmp_path):
    holder = subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    with pytest.raises(DataError, match=f"process {holder.pid} on"), locked(tmp_path):
        pass
    holder.send_signal(signal.SIGKILL)
    holder.communicate()
    assert (tmp_path / LOCK).exists()
    with locked(tmp_path):
        assert json.loads((tmp_path / OWNER).read_text())["pid"] == os.getpid()

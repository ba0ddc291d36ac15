"""The page on which a pick plays; needs no package for arms."""

import socket
import time
import urllib.request
from collections.abc import Iterator
from urllib.error import URLError

import numpy as np
import pytest
import trimesh

from icgnet.arm.motion import Motion, MovingPart
from icgnet.errors import DataError
from icgnet.viewer.pick_web import PickViewer, open_pick_viewer

ALWAYS = np.array([True])


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def made_motion() -> Motion:
    """A hand that goes up by 0.1 m a second for 2 s, a ball that vanishes after 1.5 s, a box that stands."""
    times = np.linspace(0.0, 2.0, 51)
    rising = np.tile(np.eye(4), (51, 1, 1))
    rising[:, 2, 3] = 0.1 * times
    still = np.eye(4)[None]
    return Motion(
        title="object 7",
        times=times,
        parts=(
            MovingPart("support", "support", -1, trimesh.creation.box((2.0, 2.0, 0.2)), still, ALWAYS),
            MovingPart("palm", "hand", -1, trimesh.creation.box((0.1, 0.1, 0.1)), rising, ALWAYS),
            MovingPart("object 7", "object", 7, trimesh.creation.icosphere(radius=0.05), rising, times <= 1.5),
            MovingPart("object 1", "object", 1, trimesh.creation.box((0.1, 0.2, 0.3)), still, ALWAYS),
        ),
        phase_ends=np.array([1.0, 2.0]),
        captions=("lift", "carry, 12 mm from object 1"),
    )


@pytest.fixture
def viewer(tmp_path) -> Iterator[PickViewer]:
    """A viewer of a file, as a user opens it."""
    made_motion().write(tmp_path / "motion.npz")
    viewer = open_pick_viewer(tmp_path / "motion.npz", port=free_port())
    yield viewer
    viewer.stop()


def until(is_so, seconds=20.0) -> bool:
    end = time.monotonic() + seconds
    while not is_so() and time.monotonic() < end:
        time.sleep(0.02)
    return is_so()


def test_the_page_is_served_until_it_is_stopped(viewer):
    with urllib.request.urlopen(viewer.url, timeout=10) as page:
        assert page.status == 200
    viewer.stop()
    assert not viewer._thread.is_alive()
    with pytest.raises(URLError):
        urllib.request.urlopen(viewer.url, timeout=2)


def test_the_slider_moves_what_moves(viewer):
    palm, ball, standing = viewer.parts[1], viewer.parts[2], viewer.parts[3]
    assert sorted(viewer.parts) == [1, 2, 3]  # the support is a grid
    for moment in (0.0, 0.8, 2.0, 1.2):
        viewer.show(moment)
        assert palm.position[2] == pytest.approx(0.1 * moment, abs=1e-6)
        assert ball.visible == (moment <= 1.5)
        assert standing.position.tolist() == [0.0, 0.0, 0.0]
    assert ball.position[2] == pytest.approx(0.12, abs=1e-6)
    assert viewer._caption.content == "carry, 12 mm from object 1"
    viewer.show(0.4)
    assert viewer._caption.content == "lift"
    viewer.show(99.0)
    assert viewer.time == 2.0


def test_play_lets_time_go_on_and_pause_stops_it(viewer):
    palm = viewer.parts[1]
    viewer.play()
    assert viewer._button.label == "Pause"
    assert until(lambda: viewer.time > 0.2)
    viewer.pause()
    assert viewer._button.label == "Play"
    time.sleep(0.2)  # a step that was under way
    stopped = viewer.time
    assert palm.position[2] == pytest.approx(0.1 * stopped, abs=0.003)
    time.sleep(0.3)
    assert viewer.time == stopped


def test_at_the_end_it_starts_again_or_stops(viewer):
    viewer.show(1.9)
    viewer._go_on(0.5)
    assert viewer.time == 0.0
    viewer._repeat.value = False
    viewer.show(1.9)
    viewer._go_on(0.5)
    assert viewer.time == 2.0
    assert not viewer.is_playing
    viewer.play()
    assert viewer.time < 2.0


def test_speed_is_a_share_of_real_time(viewer):
    viewer._speed.value = "0.25 x"
    viewer._go_on(0.4)
    assert viewer.time == pytest.approx(0.1)


def test_a_file_that_is_no_motion_is_refused(tmp_path):
    (tmp_path / "motion.npz").write_bytes(b"none")
    with pytest.raises(DataError, match="is not a saved motion"):
        open_pick_viewer(tmp_path / "motion.npz")

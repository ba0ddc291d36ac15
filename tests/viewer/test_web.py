import socket
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from urllib.error import URLError

import numpy as np
import pytest

from icgnet.errors import DataError
from icgnet.viewer.triangles import THICKNESS
from icgnet.viewer.web import WebViewer, open_viewer


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def viewer(make_prediction, tmp_path) -> Iterator[WebViewer]:
    """A viewer of a folder, as a user opens it."""
    make_prediction().save(tmp_path / "result")
    viewer = open_viewer(tmp_path / "result", port=free_port())
    yield viewer
    viewer.stop()


def test_the_page_is_served_until_it_is_stopped(viewer):
    with urllib.request.urlopen(viewer.url, timeout=10) as page:
        assert page.status == 200
        assert b"<html" in page.read()
    viewer.stop()
    with pytest.raises(URLError):
        urllib.request.urlopen(viewer.url, timeout=2)


def test_the_score_threshold_and_the_object_switches_hide_hands(viewer):
    assert viewer.visible_hands() == 4
    viewer._threshold.value = 0.9
    viewer._update()
    assert viewer.visible_hands() == 1
    viewer._threshold.value = 0.0
    viewer._parts[0].switch.value = False
    viewer._update()
    assert viewer.visible_hands() == 2
    viewer._count.value = 20
    viewer._update()
    assert viewer.visible_hands() == 3


def test_hands_are_shown_as_far_open_as_they_were_checked(make_prediction):
    found = make_prediction(grasps_each=1)
    fully = replace(found, grasps=replace(found.grasps, openings=np.full(2, 0.08)))
    viewer = open_viewer(fully, port=free_port())
    try:
        assert [np.ptp(hand.slim.vertices[:, 1]) for hand in viewer._hands] == pytest.approx([0.08 + 2 * THICKNESS] * 2)
    finally:
        viewer.stop()


def test_an_empty_prediction_can_be_viewed(make_prediction):
    found = make_prediction(grasps_each=0)
    viewer = open_viewer(replace(found, objects=(), cloud_instances=0 * found.cloud_instances - 1), port=free_port())
    try:
        assert viewer.visible_hands() == 0
    finally:
        viewer.stop()


def test_a_folder_that_is_no_prediction_is_refused(tmp_path):
    with pytest.raises(DataError, match="not a saved prediction"):
        open_viewer(tmp_path)

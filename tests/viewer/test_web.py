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


def test_looking_at_one_object_shows_its_grasps_only(viewer):
    assert len(viewer.grasps.hands.visible()) == 4
    viewer.objects.choose(1)
    assert set(viewer.grasps.hands.grasps.instances[viewer.grasps.hands.visible()]) == {1}
    viewer.objects.choose(None)
    assert len(viewer.grasps.hands.visible()) == 4


def test_hands_are_shown_as_far_open_as_they_were_checked(make_prediction):
    found = make_prediction(grasps_each=1)
    fully = replace(found, grasps=replace(found.grasps, openings=np.full(2, 0.08)))
    viewer = open_viewer(fully, port=free_port())
    try:
        hands = [viewer.grasps.hands.mesh(g) for g in range(2)]
        assert [np.ptp(hand.vertices[:, 1]) for hand in hands] == pytest.approx([0.08 + 2 * THICKNESS] * 2)
    finally:
        viewer.stop()


def test_rejected_grasps_stand_where_they_would_be_in_the_scene(rejecting_prediction):
    viewer = open_viewer(rejecting_prediction, port=free_port())
    try:
        assert len(viewer.rejected.hands.visible()) == 0
        viewer.rejected._switch.value = True
        viewer.update()
        shown = viewer.rejected.hands.visible()
        assert len(shown) == 3
        for g in shown:
            at = viewer.rejected.hands.mesh(int(g)).position
            expected = rejecting_prediction.rejections.grasps.transformed(viewer.T_table_frame).poses[g, :3, 3]
            np.testing.assert_allclose(at, expected)
    finally:
        viewer.stop()


def test_an_empty_prediction_can_be_viewed(make_prediction):
    found = make_prediction(grasps_each=0)
    viewer = open_viewer(replace(found, objects=(), cloud_instances=0 * found.cloud_instances - 1), port=free_port())
    try:
        assert len(viewer.grasps.hands.visible()) == 0
    finally:
        viewer.stop()


def test_a_folder_that_is_no_prediction_is_refused(tmp_path):
    with pytest.raises(DataError, match="not a saved prediction"):
        open_viewer(tmp_path)

"""The web viewer as a person uses it: Chromium without a display, clicked at, looked at."""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float
from PIL import Image

from headless_browser import SIZE, ViewerPage, chromium
from icgnet.geometry.transforms import quaternion_to_matrix
from icgnet.viewer.web import WebViewer, open_viewer

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def viewer(browser, crowded_prediction, tmp_path_factory) -> Iterator[WebViewer]:
    """A viewer of a saved scene with twenty objects, of which every other one has no grasp."""
    folder = tmp_path_factory.mktemp("crowded") / "result"
    crowded_prediction.save(folder)
    viewer = open_viewer(folder, port=8200)
    yield viewer
    viewer.stop()


@pytest.fixture(scope="module")
def opened(browser, viewer) -> ViewerPage:
    """The page, opened once: to load it takes most of the time."""
    return ViewerPage(browser, viewer.url)


@pytest.fixture
def page(opened, viewer) -> Iterator[ViewerPage]:
    """The page with all objects chosen; nothing may have gone wrong on it in the end."""
    viewer.objects.choose(None)
    yield opened
    assert opened.errors == []


def shot(page: ViewerPage, path: Path) -> np.ndarray:
    """A picture of the page, which is also kept to be looked at: [h w 3] from 0 to 255."""
    page.page.wait_for_timeout(500)  # what the server said is drawn
    picture = Image.open(io.BytesIO(page.page.screenshot(path=path)))
    return np.asarray(picture.convert("RGB")).astype(int)


def changed(before: np.ndarray, after: np.ndarray) -> int:
    """In how many pixels two pictures differ clearly."""
    return int((np.abs(before - after).max(axis=2) > 40).sum())


def pixel_of(viewer: WebViewer, page: ViewerPage, point: Float[np.ndarray, "3"]) -> tuple[float, float]:
    """Where a point of the scene [m] is in the 3D view."""
    page.wait_for(lambda: len(viewer.server.get_clients()) > 0, "a camera")
    camera = list(viewer.server.get_clients().values())[-1].camera
    view = page.page.locator("canvas").first.bounding_box()
    assert view is not None
    x, y, z = quaternion_to_matrix(np.asarray(camera.wxyz)).T @ (point - np.asarray(camera.position))
    focal = view["height"] / 2 / np.tan(camera.fov / 2)
    return view["width"] / 2 + focal * x / z, view["height"] / 2 + focal * y / z


def test_at_first_sight_all_objects_are_listed_with_their_grasps_or_the_reason(page, tmp_path):
    told = page.text()
    assert "20 objects" in told
    assert "10 objects without a grasp" in told
    assert "base_link" in told
    assert "the table was a close choice" in told
    assert told.count("would hit measured points") >= 10
    picture = shot(page, tmp_path / "first.png")
    assert len(np.unique(picture[:, : SIZE["width"] // 2].reshape(-1, 3), axis=0)) > 50, "something is drawn"
    # Twenty objects push no panel off the page.
    for panel in ("Grasps", "Rejected grasps", "Scene", "Hide objects"):
        box = page.page.get_by_text(panel, exact=True).bounding_box()
        assert box is not None
        assert box["y"] + box["height"] < SIZE["height"], panel
    assert len(page.options("Object")) == 21


def test_an_object_without_grasps_shows_what_was_in_the_way(page, viewer, tmp_path):
    page.choose("Object", "7 box · 0 grasps")
    page.wait_for(lambda: viewer.objects.chosen == 7, "the choice")
    page.see("40 low score (best 0.04)")
    assert len(viewer.grasps.hands.visible()) == 0
    before = shot(page, tmp_path / "none.png")

    page.check("Show rejected")
    page.wait_for(lambda: len(viewer.rejected.hands.visible()) == 3, "rejected grasps")
    shown = viewer.rejected.hands.visible()
    assert set(viewer.rejected.hands.grasps.instances[shown]) == {7}
    assert changed(before, shot(page, tmp_path / "rejected.png")) > 200

    reason = next(option for option in page.options("Reason") if option.startswith("low score"))
    page.page.get_by_role("option", name=reason).click()
    page.wait_for(lambda: len(viewer.rejected.hands.visible()) == 1, "the reason")
    page.check("Show rejected", on=False)
    page.wait_for(lambda: len(viewer.rejected.hands.visible()) == 0, "no rejected grasps")


def test_the_slider_hides_grasps_with_lower_scores(page, viewer):
    assert len(viewer.grasps.hands.visible()) == 20
    page.slide("Lowest score", 0.65)
    page.wait_for(lambda: len(viewer.grasps.hands.visible()) < 20, "the slider")
    shown = viewer.grasps.hands.grasps.select(viewer.grasps.hands.visible())
    lowest = float(page.page.locator("input[inputmode=decimal]").first.input_value())
    assert lowest == pytest.approx(0.65, abs=0.05)
    assert 0 < len(shown) < 20
    assert shown.scores.min() >= lowest
    page.see(f"{len(shown)} of 30 grasps are shown")
    page.slide("Lowest score", 0.0)
    page.see("20 of 30 grasps are shown")


def test_a_click_on_an_object_chooses_it_and_the_surroundings_can_be_hidden(page, viewer, tmp_path):
    page.click_at(pixel_of(viewer, page, np.array([0.24, 0.0, 0.09])))
    page.wait_for(lambda: viewer.objects.chosen == 2, "the choice by a click")
    page.see("TCP in base_link")
    before = shot(page, tmp_path / "object.png")
    page.open_folder("Scene")
    for label in ("Background", "Support plane"):
        page.check(label, on=False)
    page.wait_for(lambda: not viewer.surroundings._table.visible, "no plane")
    assert not viewer.surroundings._cloud.visible
    page.check("Rival planes")
    page.wait_for(lambda: viewer.surroundings._others[0].visible, "the rival")
    assert changed(before, shot(page, tmp_path / "bare.png")) > 2000

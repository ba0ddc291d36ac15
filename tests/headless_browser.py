"""A page of the web viewer in headless Chromium, and the clicks that a person would make on it."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Page

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
    # WebGL on the CPU.
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
)
SIZE = {"width": 900, "height": 720}
PATIENCE = 120_000
"""How long a page may take on a busy machine [ms]."""


@contextmanager
def chromium() -> Iterator[Any]:
    """The browser; the test is skipped where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright: pip install playwright")
    if CHROMIUM is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=list(OPTIONS), timeout=PATIENCE)
        yield browser
        browser.close()


class ViewerPage:
    """The open page.

    Attributes:
        page: of playwright.
        errors: what the page complained of.
    """

    def __init__(self, browser: Any, url: str) -> None:
        self.page: Page = browser.new_page(viewport=SIZE)
        self.page.set_default_timeout(PATIENCE)
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda said: self.errors.append(said.text) if said.type == "error" else None)
        self.page.on("requestfailed", lambda request: self.errors.append(f"{request.url}: {request.failure}"))
        self.page.goto(url)
        self.see("Lowest score")

    def see(self, text: str) -> None:
        """Waits until a text is to be seen."""
        self.page.get_by_text(text).first.wait_for()

    def text(self) -> str:
        """All that can be read on the page."""
        return self.page.locator("body").inner_text()

    def open_folder(self, name: str) -> None:
        """Opens a folder that is closed, or closes it."""
        self.page.get_by_text(name, exact=True).click()

    def check(self, label: str, on: bool = True) -> None:
        """Switches a checkbox on or off."""
        self.page.get_by_label(label, exact=True).set_checked(on)

    def options(self, label: str) -> list[str]:
        """What a list offers; it stays open."""
        self.page.get_by_label(label, exact=True).first.click()
        self.page.get_by_role("option").first.wait_for()
        return self.page.get_by_role("option").all_inner_texts()

    def choose(self, label: str, option: str) -> None:
        """Chooses from a list."""
        self.options(label)
        self.page.get_by_role("option", name=option, exact=True).click()

    def slide(self, label: str, share: float) -> None:
        """Clicks on the track of a slider, at this share of its length."""
        key = self.page.get_by_text(label, exact=True).get_attribute("for")
        box = self.page.locator(f'[id="{key}"]').bounding_box()
        assert box is not None
        self.page.mouse.click(box["x"] + share * box["width"], box["y"] + box["height"] / 2)

    def click_at(self, pixel: tuple[float, float]) -> None:
        """Clicks at a place of the 3D view, as (u, v) from its upper left corner."""
        box = self.page.locator("canvas").first.bounding_box()
        assert box is not None
        self.page.mouse.click(box["x"] + pixel[0], box["y"] + pixel[1])

    def wait_for(self, holds: Callable[[], bool], what: str) -> None:
        """Waits until the server has followed; the page goes on meanwhile."""
        for _ in range(PATIENCE // 100):
            if holds():
                return
            self.page.wait_for_timeout(100)
        pytest.fail(f"{what} did not happen within {PATIENCE // 1000} s")

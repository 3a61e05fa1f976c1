"""The page of a run as a person sees it: in Chromium, of real processes."""

import re
import shutil
import signal
from collections.abc import Iterator
from typing import Any

import pytest

from tests.end_to_end.conftest import SMALL, Stage
from tests.patience import PATIENCE, wait_until

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("chrome")
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed: make browser")


SCALES = """async curves => {
    const {Chart} = await import("/charts.js");
    return curves.map(curve => {
        const chart = new Chart(document.body, {meaning: "", label: "", form: ".1"});
        chart.set(curve);
        const told = [...chart.svg.querySelectorAll("text")].map(each => each.textContent);
        chart.svg.parentElement.remove();
        return told;
    });
}"""
"""What is written in charts of these curves."""


class Browser:
    """A page in a window, and what it complained of or asked for."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.complaints: list[str] = []
        self.asked: set[str] = set()
        page.set_default_timeout(PATIENCE * 1_000)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("console", lambda message: self.complaints.append(message.text))
        page.on("request", lambda request: self.asked.add(request.url))

    def picture(self) -> str:
        """The picture that is shown, or nothing."""
        shown = "document.querySelector('#picture')"
        source: str = self.page.evaluate(f"{shown}.naturalWidth ? {shown}.src : ''")
        return source

    def points(self, chart: int) -> int:
        """Points on the line of the chart in that place."""
        line = f"#curves > .chart:nth-child({chart}) path.line"
        path = self.page.evaluate(f"document.querySelector('{line}')?.getAttribute('d') ?? ''")
        return len(re.findall("[ML]", path))

    def text(self, selector: str) -> str:
        told: str = self.page.text_content(selector)
        return told

    def until(self, done: Any, what: str) -> None:
        def is_done() -> bool:
            self.page.wait_for_timeout(50)  # which lets the browser's events come in
            return bool(done())

        wait_until(is_done, what)


@pytest.fixture
def browser() -> Iterator[Browser]:
    with (
        playwright.sync_playwright() as driver,
        driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS) as chromium,
    ):
        yield Browser(chromium.new_page(viewport={"width": 1280, "height": 800}))


def test_a_person_sees_the_robots_play_and_the_curves_grow(stage: Stage, browser: Browser) -> None:
    learner = stage.learner(
        *("--local", "--evaluators=0", "--env=ale", "--game=pong", "--web=127.0.0.1:0"), *SMALL
    )
    learner.says("watch the run at http://")
    found = re.search(r"http://127\.0\.0\.1:\d+/", learner.output)
    assert found is not None
    browser.page.goto(found[0])

    browser.until(browser.picture, "a picture is shown")
    first, pictures = browser.picture(), set[str]()

    def moves() -> bool:
        pictures.add(browser.picture())
        return len(pictures - {first}) >= 3

    browser.until(moves, "the picture moves")
    assert browser.text("#who") == "actor-1"
    values = "#values li"
    assert browser.page.locator(values).count() == 6  # Pong's own actions
    assert re.fullmatch(r"score -?\d+step \d+", browser.text("#score"))

    # Loss, steps per second and updates per second are there once it learns.
    browser.until(lambda: all(browser.points(chart) >= 3 for chart in (3, 4, 5)), "curves grow")
    assert "actor-1" in browser.text("#actors")
    assert "valid frames" in browser.text("#checks")
    assert "actor-1 joined" in browser.text("#events")
    drawn = browser.points(4)
    browser.page.reload()
    browser.until(lambda: browser.points(4) >= drawn, "a reload has the curves as they were")

    scales = browser.page.evaluate(SCALES, [[], [[0, 0.0]] * 2, [[0, 0.0], [9, 0.0]]])
    assert scales[:2] == [["no curve yet"]] * 2
    assert scales[2] == ["0", "0.5", "1", "0", "9 steps"]

    picture = stage.folder / "page.png"
    browser.page.screenshot(path=picture)
    assert picture.stat().st_size > 20_000
    wide = "document.documentElement.scrollWidth - innerWidth"
    for width in (1280, 420):
        browser.page.set_viewport_size({"width": width, "height": 800})
        assert browser.page.evaluate(wide) <= 0, "nothing sticks out"
    assert {url[: len(found[0])] for url in browser.asked if not url.startswith("data:")} == {
        found[0]
    }
    assert browser.complaints == []

    learner.send(signal.SIGINT)
    learner.ends()
    browser.until(lambda: "no answer" in browser.text("#link"), "the page says that the run ended")

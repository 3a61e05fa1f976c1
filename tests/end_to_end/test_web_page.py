"""The page of a run as a person sees it: in Chromium, of real processes."""

import re
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.end_to_end.conftest import SMALL, Program, Stage
from tests.patience import PATIENCE, wait_until
from viewer.movie import open_movie

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
        const texts = [...chart.svg.querySelectorAll("text")];
        const told = texts.map(each => each.getBBox().x < 0 ? "cut" : each.textContent);
        told.push(chart.now.textContent);
        chart.svg.parentElement.remove();
        return told;
    });
}"""
"""What is written in charts of these curves."""

COLOURS = """[...document.querySelectorAll("#link, #actors tr:not(:first-child)")].map(
    each => getComputedStyle(each).color
)"""
"""Colours of a quiet text, and of each actor's row."""

DECODED = """film => {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [film.videoWidth, film.videoHeight];
    const ink = canvas.getContext("2d");
    ink.drawImage(film, 0, 0);
    return [...ink.getImageData(canvas.width / 2, canvas.height / 2, 1, 1).data].slice(0, 3);
}"""
"""The colour in the middle of what a film shows."""


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


def page_of(learner: Program) -> str:
    """Returns the address of a run's page, once it is served."""
    learner.says("watch the run at http://")
    found = re.search(r"http://127\.0\.0\.1:\d+/", learner.output)
    assert found is not None
    return found[0]


def test_a_person_sees_the_robots_play_and_the_curves_grow(stage: Stage, browser: Browser) -> None:
    # In real time, or all cores would play while the browser draws.
    flags = ("--local", "--evaluators=0", "--env=robot", "--no-sync", "--speed=4")
    learner = stage.learner(*flags, "--game=pong", "--web=127.0.0.1:0", *SMALL)
    address = page_of(learner)
    browser.page.goto(address)

    browser.until(browser.picture, "a picture is shown")
    first, pictures = browser.picture(), set[str]()

    def moves() -> bool:
        pictures.add(browser.picture())
        return len(pictures - {first}) >= 3

    browser.until(moves, "the picture moves")
    assert browser.text("#who") == "actor-1"
    values = "#values li"
    assert browser.page.locator(values).count() == 6  # Pong's own actions
    assert re.fullmatch(r"score −?\d+step \d+", browser.text("#score"))

    # Loss, steps per second and updates per second are there once it learns.
    browser.until(lambda: all(browser.points(chart) >= 3 for chart in (3, 4, 5)), "curves grow")
    assert "actor-1" in browser.text("#actors")
    assert "valid frames" in browser.text("#checks")
    assert "actor-1 joined" in browser.text("#events")
    drawn = browser.points(4)
    browser.page.reload()
    browser.until(lambda: browser.points(4) >= drawn, "a reload has the curves as they were")

    curves = [[], [[0, 0.0]] * 2, [[0, 0.0], [9, 0.0]], [[0, -21.0], [9, -20.0]]]
    curves += [[[0, 0.000499], [9, 0.0005]], [[0, -34.50611], [9, 5_000.0]]]
    scales = browser.page.evaluate(SCALES, curves)
    assert scales[:2] == [["no curve yet", "–"], ["no curve yet", "0.0"]]
    assert scales[2:] == [
        ["0", "0.5", "1", "0", "9 steps", "0.0"],
        ["−21", "−20.5", "−20", "0", "9 steps", "−20.0"],
        ["0.000499", "0.0004995", "0.0005", "0", "9 steps", "0.0"],
        ["0", "2,000", "4,000", "0", "9 steps", "5,000.0"],
    ]

    def redden(route: Any) -> None:
        answer = route.fetch()
        state = answer.json()
        state["checks"][0]["passed"] = False
        state["actors"] = [state["actors"][0] | {"gone": gone} for gone in ("", "left", "lost")]
        route.fulfill(response=answer, json=state)

    why = "the screen is not found in the camera's picture"
    assert why not in browser.text("#checks")
    browser.page.route("**/state?*", redden)
    browser.until(lambda: why in browser.text("#checks"), "a red check says why")
    of_link, *colours = browser.page.evaluate(COLOURS)
    assert len({*colours}) == 3, "an actor that was lost is red"
    assert colours[1] == of_link, "one that left is not"
    browser.page.unroute("**/state?*")

    picture = stage.folder / "page.png"
    browser.page.screenshot(path=picture)
    assert picture.stat().st_size > 20_000
    wide = "document.documentElement.scrollWidth - innerWidth"
    for width in (1280, 901, 900, 600, 420):
        browser.page.set_viewport_size({"width": width, "height": 800})
        assert browser.page.evaluate(wide) <= 0, "nothing sticks out"
    assert {url[: len(address)] for url in browser.asked if not url.startswith("data:")} == {
        address
    }
    assert browser.complaints == []

    def finish(route: Any) -> None:
        answer = route.fetch()
        state = answer.json()
        state["run"]["phase"], state["actors"] = "finishing", []
        route.fulfill(response=answer, json=state)

    browser.page.route("**/state?*", finish)
    browser.until(lambda: browser.text("#link") == "finishing", "the run has its steps")
    browser.until(lambda: browser.text("#silence") == "Nobody plays now.", "its actors have left")
    browser.page.route("**/state?*", lambda route: route.abort())
    browser.until(lambda: browser.text("#link") == "the run has ended", "it needs no answer now")
    browser.page.unroute("**/state?*")
    browser.until(lambda: browser.text("#link") in ("warm-up", "training"), "it answers again")

    learner.send(signal.SIGINT)
    learner.ends()
    browser.until(lambda: "no answer" in browser.text("#link"), "the page says that the run ended")


def add_film(run: Path, name: str, *colours: tuple[int, int, int]) -> None:
    """Puts a film into a run as `FilmsSink` does: whole, at once. Each colour lasts 2 s."""
    making = run / "films" / "making" / name
    with open_movie(making, 15.0) as add:
        for colour in colours:
            for _ in range(30):
                add(np.full((768, 1024, 3), colour, np.uint8))
    making.replace(run / "films" / name)


def test_a_film_of_the_run_plays(stage: Stage, browser: Browser) -> None:
    """H.264 in MP4, of which Debian's Chromium has a decoder of its own."""
    learner = stage.learner("--env=ale", "--game=pong", "--web=127.0.0.1:0", *SMALL)
    browser.page.goto(page_of(learner))
    browser.until(lambda: browser.text("#link"), "the page is there")
    assert browser.page.is_hidden("#cinema")
    add_film(stage.run, "epoch-0001.mp4", (200, 30, 30), (30, 30, 200))
    browser.until(lambda: browser.page.is_visible("#cinema"), "the page offers the film")

    film = browser.page.locator("#films video").element_handle()
    assert browser.text("#films figcaption") == "epoch-0001.mp4"
    # It begins anew at its end: on a busy machine that comes before this test looks again.
    film.evaluate("film => { film.loop = true; film.play(); }")

    def time() -> float:
        assert film.evaluate("film => film.error?.message") is None
        seconds: float = film.evaluate("film => film.currentTime")
        return seconds

    browser.until(lambda: time() > 0.2, "it plays")
    assert film.evaluate("film => [film.videoWidth, film.videoHeight]") == [1024, 768]
    assert film.evaluate("film => film.duration") == pytest.approx(4.0, abs=0.1)

    add_film(stage.run, "epoch-0002.mp4", (30, 200, 30))
    browser.until(lambda: browser.page.locator("#films video").count() == 2, "another film comes")
    assert browser.text("#films figure:first-child") == "epoch-0002.mp4"
    assert film.evaluate("film => film.isConnected && !film.paused"), "it is not begun anew"
    began = time()
    browser.until(lambda: time() != began, "the first one plays on")
    film.evaluate("film => film.pause()")
    for seconds, colour in ((1, (200, 30, 30)), (3, (30, 30, 200)), (1, (200, 30, 30))):
        film.evaluate("(film, seconds) => { film.currentTime = seconds; }", seconds)
        browser.until(lambda: not film.evaluate("film => film.seeking"), "a person moves in it")
        np.testing.assert_allclose(film.evaluate(DECODED), colour, atol=6)
    assert browser.complaints == []

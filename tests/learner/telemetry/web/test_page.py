"""The page's server, asked by HTTP: what it tells, to whom, and what it refuses."""

import contextlib
import http.client
import itertools
import json
import os
import socket
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from common.errors import InputError
from common.metrics import Value
from common.process import http_server
from common.process.threads import end_with_any_thread
from common.protocol.actor_stats import ActorStats
from common.protocol.live_view import ViewRequest
from common.protocol.run_keys import RunKeys
from common.protocol.run_status import HealthCheck
from common.run.epochs import EpochTable
from common.run.folder import RunFolder
from common.settings.presets import PRESETS
from common.transport.interface import Request, Transport
from learner.options import web_address
from learner.telemetry import live_feed
from learner.telemetry.live_feed import Asked, LiveFeed
from learner.telemetry.sinks.tensorboard import TensorBoardSink
from learner.telemetry.snapshot import ActorView
from learner.telemetry.web.page_sink import PageSink
from tests.common.protocol.test_live_view import VIEW
from tests.epoch_rows import epoch_row
from tests.learner.telemetry.snapshots import changed, snapshot
from tests.patience import PATIENCE, wait_until

KEYS = RunKeys("r")
ACTOR = ActorStats("a", "actor", 1, steps=64, weights_version=3, machine="host-7", seconds=3_700.0)
"""Two updates behind the newest weights of `SNAPSHOT`."""
SNAPSHOT = snapshot(
    {"learning/loss": 0.5, "stream/weights_version": 5, "play/train_reward": float("nan")},
    actors=(ActorView(stats=ACTOR, alive=True),),
    checks=(HealthCheck(name="n", value=0.4, passed=False, bound="≥ 0.5", why="<b>bad</b>"),),
)


class Place:
    """A page, an actor that it may show, and somebody with a browser."""

    def __init__(self, hub: Transport, client: Transport, folder: Path) -> None:
        run = RunFolder(folder, "r")
        run.path.mkdir()
        self.folder = run.path
        self.epochs = EpochTable(run.epochs)
        self._actor = client
        self.asked: list[ViewRequest] = []
        self.feed = LiveFeed(hub, KEYS)
        self.page = PageSink("127.0.0.1", 0, PRESETS["robot"], run)
        self.page.watch(self.feed)
        self.port = int(self.page.url.rsplit(":", 1)[1].strip("/"))

    def serve(self, answer: Callable[[], bytes]) -> None:
        def take(request: Request) -> bytes:
            self.asked.append(ViewRequest.decode(request.payload))
            return answer()

        self._actor.serve(KEYS.view("actor", "a"), take)

    def ask(
        self, path: str, method: str = "GET", **headers: str
    ) -> tuple[int, http.client.HTTPMessage, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE)
        connection.request(method, path, headers=headers)
        answer = connection.getresponse()
        told = answer.status, answer.headers, answer.read()
        connection.close()
        return told

    def json(self, path: str) -> Any:
        status, _, body = self.ask(path)
        assert status == 200, body
        return json.loads(body)


@pytest.fixture
def place(hub: Transport, client: Transport, tmp_path: Path) -> Iterator[Place]:
    place = Place(hub, client, tmp_path)
    yield place
    place.page.close()
    place.feed.close()


def test_it_tells_the_figures_by_their_declarations(place: Place) -> None:
    place.page.start(None)
    assert place.json("/state") == {}  # before the first snapshot
    place.page.write(SNAPSHOT)
    place.page.event("a joined")
    state = place.json("/state?version=-1&count=0")
    assert state["run"]["name"] == "pong-1"
    learning = {each["label"]: each for each in state["panels"]["Learning"]}
    assert learning["loss"]["text"] == "0.5000"
    assert learning["loss"]["meaning"] == "Mean loss of the recent updates"
    assert state["curves"]["values"]["learning/loss"] == [0.5]
    assert state["curves"]["values"]["play/train_reward"] == [None]
    titles = {key: each["label"] for key, each in state["about"].items()}
    assert titles["learning/loss"] == "loss"
    assert titles["learning/held_out_std"] == "max-Q deviation"  # as its health check
    assert titles["stream/staleness_p50"] == "stream staleness p50"  # not "stale p50/95"
    assert titles["hands/release_p99"] == "release p99"
    assert state["about"]["hands/release_p99"]["unit"] == "milliseconds"
    assert (state["checks"][0]["passed"], state["checks"][0]["bound"]) == (False, "≥ 0.5")
    (actor,) = state["actors"]
    assert (actor["name"], actor["gone"], actor["machine"]) == ("a", "", "host-7")
    assert (actor["age"], actor["steps"], actor["weights"]) == ("1:01:40", "64", "2")
    assert [event["text"] for event in state["events"]] == ["a joined"]
    place.page.write(SNAPSHOT)
    news = place.json(f"/state?version={state['curves']['version']}&count=1")
    assert (news["curves"]["start"], len(news["curves"]["steps"])) == (1, 1)
    assert "about" not in news


def test_an_actor_that_left_is_not_called_lost(place: Place) -> None:
    place.page.start(None)
    left, lost = replace(ACTOR, leaving=True), replace(ACTOR, name="b")
    views = tuple(ActorView(stats=stats, alive=False) for stats in (left, lost))
    place.page.write(snapshot({}, actors=views))
    told = [(actor["rate"], actor["gone"]) for actor in place.json("/state")["actors"]]
    assert told == [("left", "left"), ("lost", "lost")]


def test_the_epochs_of_a_resumed_run_are_there(place: Place) -> None:
    place.epochs.append(epoch_row([-20.0, -21.0], epoch=1, phase="test"))
    place.page.start(17)
    place.page.phase(epoch_row([3.0], epoch=2, phase="test"), 5_000)
    place.page.write(SNAPSHOT)
    told = place.json("/state")
    rows = told["epochs"]["rows"]
    assert [(each["epoch"], each["score"]) for each in rows] == [(1, -20.5), (2, 3.0)]


def test_a_browser_gets_each_epoch_once(place: Place) -> None:
    place.page.start(None)
    place.page.phase(epoch_row([3.0], epoch=1, phase="test"), 5_000)
    place.page.write(SNAPSHOT)
    first = place.json("/state?version=-1&count=0&rows=0")
    place.page.phase(epoch_row([4.0], epoch=2, phase="test"), 6_000)
    known = f"count=1&rows={len(first['epochs']['rows'])}"
    news = place.json(f"/state?version={first['curves']['version']}&{known}")["epochs"]
    assert (news["start"], [each["epoch"] for each in news["rows"]]) == (1, [2])
    # The page of another process, or one whose curves were thinned, begins anew.
    again = place.json(f"/state?version={first['curves']['version'] + 1}&{known}")["epochs"]
    assert (again["start"], [each["epoch"] for each in again["rows"]]) == (0, [1, 2])


def test_the_curves_of_a_resumed_run_are_there(place: Place) -> None:
    written = TensorBoardSink(RunFolder(place.folder.parent, "r").tensorboard, {})
    written.start(None)
    for steps, loss in ((1_000, 4.0), (2_000, 2.0), (3_000, 1.0)):
        values: dict[str, Value] = {"run/agent_steps": steps, "learning/loss": loss}
        written.write(changed(SNAPSHOT, {**values, "play/valid_frame_share": 0.5}))
    written.close()
    written.start(2_000)
    place.page.start(2_000)
    place.page.write(changed(SNAPSHOT, {"run/agent_steps": 2_500, "learning/loss": 8.0}))
    curves = place.json("/state")["curves"]
    assert curves["steps"] == [1_000, 2_000, 2_500]
    assert curves["values"]["learning/loss"] == [4.0, 2.0, 8.0]
    assert curves["values"]["play/valid_frame_share"] == [0.5, 0.5, None]
    written.close()


def test_it_shows_what_an_actor_shows(place: Place) -> None:
    place.page.start(None)
    place.page.write(SNAPSHOT)
    place.serve(lambda: VIEW.encode())
    told = place.json("/view/actor/a?stream=1&viewpoint=hands")
    assert place.asked == [ViewRequest(1, "hands")]
    assert told["picture"].startswith("data:image/jpeg;base64,/9j/")
    assert (told["room"], told["pressed"], told["values"]) == ("", 3, [0.5, -1.25])
    assert told["keys"] == [0, 4 + 2 + 16]  # nothing; down, left and fire


def test_nothing_else_is_to_be_had(place: Place) -> None:
    (place.folder / "config.json").write_text("{}")
    (place.folder / "link.mp4").symlink_to(place.folder / "config.json")
    place.page.start(None)
    place.page.write(SNAPSHOT)
    for path in (
        *("/view/actor/b", "/view/learner/a", "/view/actor/a?viewpoint=*", "/view/actor/**"),
        *("/view/actor/a?stream=256", "/view/actor/a/b", "/page/page.js", "/../server.py"),
        *("/films/x.mp4", "/films/..%2Fconfig.json", "/films/link.mp4", "/server.py", "/docs"),
    ):
        assert place.ask(path)[0] == 404, path
    assert place.asked == []


@pytest.mark.parametrize(
    "forged",
    [
        b"",
        b"\xc1",
        bytes(2_000_000),
        replace(VIEW, picture=b"<script>alert(1)</script>").encode(),
        replace(VIEW, room=VIEW.picture * 9).encode(),
        replace(VIEW, score="<img src=x>").encode(),  # type: ignore[arg-type]
    ],
)
def test_a_forged_picture_is_not_passed_on(place: Place, forged: bytes) -> None:
    place.page.start(None)
    place.page.write(SNAPSHOT)
    place.serve(lambda: forged)
    assert place.json("/view/actor/a") is None
    assert place.json("/state")["run"]["name"] == "pong-1"


def test_many_who_watch_cost_an_actor_no_more_than_one(hub: Transport, client: Transport) -> None:
    let_go, asked = threading.Event(), []

    def answer(request: Request) -> bytes:
        asked.append(request.payload)
        let_go.wait(PATIENCE)
        return VIEW.encode()

    client.serve(KEYS.view("actor", "a"), answer)
    hours = itertools.count(0.0, 3_600.0)
    feed = LiveFeed(hub, KEYS, lambda: next(hours))
    look = Asked("actor", "a", ViewRequest())
    assert feed.latest(look) is None
    wait_until(lambda: asked, "the actor is asked")
    # Whatever time it takes, all who come meanwhile wait for the same answer.
    assert feed.latest(look) is None
    others = [feed.begin(look) for _ in range(4)]
    let_go.set()
    assert [other.result(PATIENCE) for other in others] == [VIEW] * 4
    assert len(asked) == 1
    assert feed.latest(look) == VIEW  # that of an hour ago, and asks again
    wait_until(lambda: len(asked) == 2, "the actor is asked again")
    feed.close()
    assert feed.look(look) is None


def test_a_request_that_fails_ends_nobody_who_does_not_wait_for_it() -> None:
    def fail(*given: Any) -> Any:
        raise OSError("the transport is closed")

    hours = itertools.count(0.0, 3_600.0)
    feed = LiveFeed(SimpleNamespace(gather=fail), KEYS, lambda: next(hours))
    look = Asked("actor", "a", ViewRequest())
    with pytest.raises(OSError, match="the transport is closed"):
        feed.look(look)
    assert feed.latest(look) is None
    feed.close()


def test_who_is_watched_is_not_forgotten_for_others(hub: Transport, client: Transport) -> None:
    hours = itertools.count(0.0, 3_600.0)
    feed = LiveFeed(hub, KEYS, lambda: next(hours))
    watched = Asked("actor", "a", ViewRequest())
    feed.look(watched)
    for stream in range(1, 100):  # nobody is there, so they are answered at once
        feed.look(Asked("actor", "a", ViewRequest(stream)))
        assert watched in feed._kept
        feed.look(watched)
    assert len(feed._kept) == 64
    feed.close()


def test_a_fresh_answer_serves_all(hub: Transport, client: Transport) -> None:
    asked: list[bytes] = []

    def answer(request: Request) -> bytes:
        asked.append(request.payload)
        return VIEW.encode()

    client.serve(KEYS.view("actor", "a"), answer)
    now = [0.0]
    feed = LiveFeed(hub, KEYS, lambda: now[0])
    look = Asked("actor", "a", ViewRequest())
    for now[0], times in ((0.0, 1), (live_feed._FRESH, 1), (live_feed._FRESH * 1.01, 2)):
        assert feed.look(look) == VIEW
        assert len(asked) == times
    feed.close()


def test_films_of_the_run_are_served(place: Place) -> None:
    (place.folder / "films").mkdir()
    (place.folder / "films" / "epoch 1.mp4").write_bytes(b"film")
    place.page.start(None)
    place.page.write(SNAPSHOT)
    assert place.json("/state")["films"] == ["epoch 1.mp4"]
    status, headers, body = place.ask("/films/epoch%201.mp4")
    assert (status, headers["content-type"], body) == (200, "video/mp4", b"film")
    assert place.ask("/films/epoch%201.mp4", Range="bytes=1-2")[2] == b"il"


def test_a_film_that_is_removed_meanwhile_is_not_told(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    (place.folder / "there.mp4").write_bytes(b"film")
    gone = place.folder / "gone.mp4"
    there = Path.glob
    monkeypatch.setattr(Path, "glob", lambda self, like: [gone, *there(self, like)])
    place.page.start(None)
    place.page.write(SNAPSHOT)
    assert place.json("/state")["films"] == ["there.mp4"]


def test_only_films_of_the_run_itself_are_told(place: Place) -> None:
    elsewhere = place.folder.parent / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "private.mp4").write_bytes(b"film")
    (place.folder / "films").symlink_to(elsewhere)
    (place.folder / os.fsdecode(b"\xff.mp4")).write_bytes(b"film")  # a name that JSON cannot hold
    place.page.start(None)
    place.page.write(SNAPSHOT)
    assert place.json("/state")["films"] == []
    assert place.ask("/films/private.mp4")[0] == 404


def test_who_connects_and_asks_nothing_keeps_nobody_out(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_server, "_SLOWEST", 0.2)
    monkeypatch.setattr(http_server, "_MAX_CONNECTIONS", 4)
    place.page.start(None)
    there = ("127.0.0.1", place.port)
    slow = [socket.create_connection(there, PATIENCE) for _ in range(6)]
    for each in slow:
        with contextlib.suppress(OSError):
            each.sendall(b"GET /state HTTP/1.1\r\nHost: loc")
    for each in slow:
        with contextlib.suppress(ConnectionResetError):
            assert each.recv(1) == b""
    # One that has had an answer is closed too, if it never ends the next question.
    with socket.create_connection(there, PATIENCE) as kept:
        kept.sendall(b"GET /state HTTP/1.1\r\nHost: localhost\r\n\r\nGET /")
        with contextlib.suppress(ConnectionResetError):
            while kept.recv(4_096):
                pass
    assert place.json("/state") == {}
    for each in slow:
        each.close()


def test_connections_are_bounded(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_server, "_SLOWEST", PATIENCE)
    monkeypatch.setattr(http_server, "_MAX_CONNECTIONS", 4)
    place.page.start(None)
    silent = [socket.create_connection(("127.0.0.1", place.port), PATIENCE) for _ in range(6)]
    for each in silent[4:]:
        with contextlib.suppress(ConnectionResetError):
            assert each.recv(1) == b""
    silent[0].sendall(b"GET /state HTTP/1.1\r\nHost: localhost\r\n\r\n")
    assert silent[0].recv(12) == b"HTTP/1.1 200"
    for each in silent:
        each.close()


def test_a_browser_is_told_what_it_may_do(place: Place) -> None:
    place.page.start(None)
    for path, kind in (("/", "text/html"), ("/page.css", "text/css"), ("/page.js", "javascript")):
        status, headers, body = place.ask(path)
        assert (status, kind in headers["content-type"]) == (200, True)
        assert b"http" not in body.replace(b"http://www.w3.org/2000/svg", b"")  # all is from here
        assert "default-src 'none'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["access-control-allow-origin"] is None
    for method in ("POST", "PUT", "DELETE", "PATCH"):
        assert place.ask("/state", method)[0] == 405


def test_only_who_means_it_is_answered(place: Place) -> None:
    place.page.start(None)
    for host in ("localhost:18080", "127.0.0.1", "[::1]:80", "192.0.2.7:80"):
        assert place.ask("/state", Host=host)[0] == 200, host
    evil = ("evil.example", "evil.example:80", "localhost.evil.example", "127.0.0.1.evil.example")
    for host in ("", *evil):
        assert place.ask("/state", Host=host)[0] == 421, host


def test_an_address_that_cannot_be_used_is_told(place: Place) -> None:
    assert web_address("[::1]:0") == ("::1", 0)
    assert web_address("0.0.0.0:8080") == ("0.0.0.0", 8080)
    for wrong in ("8080", "127.0.0.1", "http://127.0.0.1:80", ":80"):
        with pytest.raises(InputError, match="not an address for --web: write it"):
            web_address(wrong)
    with pytest.raises(InputError, match=r"65536 has no valid port: choose one from 0 to 65535"):
        web_address("127.0.0.1:65536")
    run = RunFolder(place.folder, "r")
    with pytest.raises(InputError, match=r"Address already in use.*choose another"):
        PageSink("127.0.0.1", place.port, PRESETS["robot"], run)


def test_a_server_that_dies_ends_its_process(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    stop = threading.Event()
    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    monkeypatch.setattr(place.page._server._server, "run", lambda sockets: None)

    def serve() -> None:
        with end_with_any_thread(stop):
            place.page.start(None)
            assert stop.wait(PATIENCE)

    with pytest.raises(InputError, match="the thread 'web' died"):
        serve()

"""Keeps what the page of a run shows, and serves it to browsers."""

import base64
import logging
import threading
import time
from collections import deque
from contextlib import suppress
from pathlib import Path
from stat import S_ISREG
from typing import Any, get_args

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from common.actions import KEYS_OF_ACTION
from common.endpoint import is_loopback
from common.process.http_server import HttpServer
from common.protocol.live_view import LiveView, Viewpoint, ViewRequest
from common.run.epochs import EpochRow, EpochTable
from common.run.folder import RunFolder
from common.settings.config import MAX_ENVS, RunConfig
from common.strict_json import strict
from learner.telemetry.live_feed import Asked, LiveFeed
from learner.telemetry.panels import metrics_of
from learner.telemetry.sinks.sink import Sink
from learner.telemetry.sinks.tensorboard import written_points
from learner.telemetry.snapshot import Snapshot
from learner.telemetry.web.figures import about, figures
from learner.telemetry.web.history import History

PAGE = Path(__file__).parent / "page"
_MAX_EVENTS = 200
_MAX_FILMS = 200
_log = logging.getLogger(__name__)


class PageSink(Sink):
    """Serves the page of a run.

    Raises InputError if this process cannot listen at the address.
    """

    period = 1.0

    def __init__(self, host: str, port: int, config: RunConfig, folder: RunFolder) -> None:
        self._config = config
        self._folder = folder.path.resolve()
        self._epochs = EpochTable(folder.epochs)
        self._written = folder.tensorboard
        self._lock = threading.Lock()
        self._curves = [each for each in metrics_of(config.env) if each.curve or each.gate]
        self._history = History(metric.key for metric in self._curves)
        self._rows: list[dict[str, Any]] = []
        self._events: deque[dict[str, Any]] = deque(maxlen=_MAX_EVENTS)
        self._snapshot: Snapshot | None = None
        self._feed: LiveFeed
        routes = [
            Route("/state", self._state),
            Route("/view/{role}/{name}", self._view),
            Route("/films/{name}", self._film),
            Mount("/", StaticFiles(directory=PAGE, html=True)),
        ]
        self._server = HttpServer(Starlette(routes=routes), host, port, "--web")
        self.url = self._server.url
        if not is_loopback(host):
            _log.warning(
                "anybody who reaches %s can watch the run, without a password: use "
                "--web 127.0.0.1:8080 and ssh -L instead",
                self.url,
            )

    def watch(self, feed: LiveFeed) -> None:
        self._feed = feed

    def start(self, resumed_at: int | None) -> None:
        """Loads epochs and curves of a resumed run, and starts serving."""
        for row in self._epochs.rows():
            self.phase(row, row.agent_steps(self._config.replay.learning_starts))
        if resumed_at is not None:
            for values in written_points(self._written):
                self._history.add(values)
        self._server.start()

    def write(self, snapshot: Snapshot) -> None:
        with self._lock:
            self._snapshot = snapshot
            self._history.add(snapshot.values)

    def phase(self, row: EpochRow, agent_steps: int) -> None:
        with self._lock:
            self._rows.append(
                {
                    "epoch": row.epoch,
                    "phase": row.phase,
                    "agent_steps": agent_steps,
                    "games": row.nr_games,
                    "score": strict(row.average_reward),
                    "least": strict(row.min_game_reward),
                    "most": strict(row.max_game_reward),
                }
            )

    def event(self, text: str) -> None:
        with self._lock:
            self._events.append({"time": time.time(), "text": text})

    line = event

    def close(self) -> None:
        self._server.close()

    # ------------------------------------------------------------------ for browsers

    def _state(self, request: Request) -> Response:
        """Returns all that the page shows, except pictures; of curves and epochs, only what the
        browser does not have yet."""
        count = _number(request, "count")
        with self._lock:
            curves = self._history.since(_number(request, "version"), count)
            known = _number(request, "rows", 0) if curves["start"] else 0
            told = {
                "curves": curves,
                "epochs": {"start": known, "rows": self._rows[known:]},
                "events": list(self._events),
            }
            snapshot = self._snapshot
        if snapshot is None:
            return JSONResponse({})
        told["films"] = [path.name for path in self._films()]
        if count <= 0:
            told["about"] = {metric.key: about(metric) for metric in self._curves}
        return JSONResponse(told | figures(snapshot))

    def _view(self, request: Request) -> Response:
        """Returns an actor's live view; null if it does not answer."""
        role, name = request.path_params["role"], request.path_params["name"]
        viewpoint = request.query_params.get("viewpoint", "none")
        stream, snapshot = _number(request, "stream", 0), self._snapshot
        known = snapshot is not None and any(
            (each.stats.role, each.stats.name) == (role, name) for each in snapshot.present
        )
        if not known or viewpoint not in get_args(Viewpoint) or stream >= MAX_ENVS:
            return PlainTextResponse("there is no such view", 404)
        shown = self._feed.look(Asked(role, name, ViewRequest(stream, viewpoint)))  # type: ignore[arg-type]
        return JSONResponse(None if shown is None else _plain(shown))

    def _film(self, request: Request) -> Response:
        for path in self._films():
            if path.name == request.path_params["name"]:
                return FileResponse(path)
        return PlainTextResponse("there is no such film", 404)

    def _films(self) -> list[Path]:
        """Returns the newest films in the run's folder and in its ``films``; links are ignored."""
        places = (self._folder, self._folder / "films")
        own = [place for place in places if place.is_dir() and not place.is_symlink()]
        found = [path for place in own for path in place.glob("*.mp4")]
        films = []
        for path in found:
            with suppress(FileNotFoundError):  # removed since it was found
                told = path.lstat()
                if S_ISREG(told.st_mode) and path.name.isprintable():
                    films.append((told.st_mtime, path))
        return [path for _, path in sorted(films)[-_MAX_FILMS:]]


def _number(request: Request, name: str, default: int = -1) -> int:
    told = request.query_params.get(name, "")
    return int(told) if told.isascii() and told.isdigit() and len(told) < 10 else default


def _plain(view: LiveView) -> dict[str, Any]:
    """Returns a view of JSON's types, with its pictures as data URLs, and with the keys of its
    actions."""
    pictures = {
        name: f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}" if jpeg else ""
        for name, jpeg in vars(view).items()
        if isinstance(jpeg, bytes)
    }
    keys = [int(KEYS_OF_ACTION[action]) for action in view.actions]
    return {**vars(view), **pictures, "keys": keys}

"""What an actor shows to those who ask, and that nobody is shown anything unasked."""

import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from actors.envs.ale import AtariEnv
from actors.envs.checked import CheckedEnv
from actors.envs.game_env import GameEnv
from actors.envs.robot import RobotEnv
from actors.loop import Step, play
from actors.member import Member
from actors.policy import Policy
from actors.stream import live_views
from actors.stream.live_views import LiveViews
from common.actions import KEYS_OF_ACTION
from common.errors import MessageError
from common.network import build_network
from common.protocol.live_view import (
    MAX_PICTURE_BYTES,
    VIEW_SECONDS,
    LiveView,
    Viewpoint,
    ViewRequest,
)
from common.protocol.run_keys import RunKeys
from common.settings.conditions import PlayConfig
from common.settings.presets import PRESETS
from common.transport.interface import Envelope, Transport
from tests.actors.numbered_env import GOES_ON, NumberedEnv
from tests.patience import PATIENCE

KEYS = RunKeys("r")
PLAY = PlayConfig(minimal_actions=True, random_starts=0)
Env = AtariEnv | RobotEnv | NumberedEnv


class Stage:
    """An actor that plays, and somebody who looks."""

    def __init__(self, hub: Transport, client: Transport, *envs: Env) -> None:
        config = replace(PRESETS["fast"], play=PLAY)
        shown = [env if isinstance(env, GameEnv) else CheckedEnv(env, config) for env in envs]
        network = build_network(config, 6)
        self.policy = Policy(network, 6, np.random.default_rng(0), envs=len(envs))
        self.policy.epsilon = 0.0
        member = Member("a", client, KEYS, config, PATIENCE, threading.Event())
        self._views = LiveViews(member, "actor", shown, self.policy)
        self._steps = play(shown, self.policy, [1] * len(envs))
        self._requester = hub.requester(KEYS.view("actor", "a"), PATIENCE)

    def ask(self, stream: int = 0, viewpoint: Viewpoint = "none") -> Future[Envelope]:
        return self._requester.request(ViewRequest(stream, viewpoint).encode())

    def steps(self, answer: Future[Envelope]) -> Iterator[Step]:
        """Play until the answer is there."""
        until = time.monotonic() + PATIENCE
        for step in self._steps:
            if answer.done():
                return
            assert time.monotonic() < until, "nobody answers"
            self._views.show(step)
            yield step


@pytest.fixture(autouse=True)
def _at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_views, "_PERIOD", 0.0)
    monkeypatch.setattr(live_views, "_REST", 0.0)


def decoded(jpeg: bytes) -> NDArray[np.uint8]:
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return np.asarray(picture[:, :, ::-1], np.uint8)


def difference(jpeg: bytes, picture: NDArray[np.uint8]) -> float:
    return float(np.abs(decoded(jpeg).astype(float) - picture).mean())


def test_a_robot_shows_what_it_sees_presses_and_thinks(hub: Transport, client: Transport) -> None:
    env = RobotEnv(play=PLAY)
    stage = Stage(hub, client, env)
    answer = stage.ask(viewpoint="room")
    told = {}
    for step in stage.steps(answer):
        values = stage.policy.q_values(step.s_tm1[None], step.x_tm1[None])[0]
        shown = (env.seen.copy(), env.detection.corners, env.wanted, env.pressed, values)
        told[step.info.game_steps] = (step.s_t[-1].copy(), step.a_tm1, *shown)
    view = LiveView.decode(answer.result().payload)
    frame, action, seen, corners, wanted, pressed, values = told[view.steps]
    assert decoded(view.picture).shape == (240, 320, 3)
    assert difference(view.picture, seen) < 4
    assert difference(view.frame, frame[:, :, None]) < 4
    assert decoded(view.room).shape == (360, 480, 3)
    assert np.ptp(decoded(view.room)) > 100
    assert corners is not None
    found = np.reshape(view.game, (4, 2)) * (320, 240) - 0.5
    np.testing.assert_allclose(found, corners, atol=1e-3)
    outer, inner = (np.ptp(np.reshape(each, (4, 2)), axis=0) for each in (view.border, view.game))
    np.testing.assert_allclose(outer / inner, 1.16, atol=0.02)  # 8 % on either side
    assert (view.wanted, view.pressed) == (wanted, pressed)
    assert (view.chosen, view.explored, view.found) == (action, False, True)
    np.testing.assert_allclose(view.values, values)
    assert np.argmax(view.values) == view.chosen
    assert view.actions == env.emulator.minimal_actions
    env.close()


def test_each_environment_of_an_actor_is_shown(hub: Transport, client: Transport) -> None:
    envs = AtariEnv(play=PLAY), NumberedEnv([GOES_ON])
    stage = Stage(hub, client, *envs)
    console, numbered = stage.ask(0), stage.ask(1)
    screens, actions = {}, {}
    for answer in (console, numbered):
        for step in stage.steps(answer):
            if step.stream == 0:
                screens[step.info.game_steps] = envs[0].emulator.screen_rgb()
                actions[step.info.game_steps] = step.a_tm1
    view = LiveView.decode(console.result().payload)
    assert difference(view.picture, screens[view.steps]) < 6
    keys = KEYS_OF_ACTION[view.actions[actions[view.steps]]]
    assert (view.wanted, view.pressed) == (keys, keys)
    assert (view.streams, view.room, view.border) == (2, b"", ())
    other = LiveView.decode(numbered.result().payload)
    assert (other.actions, other.wanted) == ((), 0)
    assert decoded(other.frame).shape == (84, 84, 3)
    assert difference(other.frame, decoded(other.picture)[:, 14:98]) < 1  # without margins
    assert len(other.values) == 6


class Rendering(NumberedEnv):
    """Renders the number of its steps, unless ``fault`` hinders it."""

    render_mode = "rgb_array"
    fault: Exception | None = None

    def render(self) -> Any:
        if self.fault is not None:
            raise self.fault
        return np.full((30, 40, 3), len(self.moments), np.uint8)


def test_an_environment_from_outside_shows_what_it_renders(
    hub: Transport, client: Transport
) -> None:
    stage = Stage(hub, client, Rendering([GOES_ON]))
    answer = stage.ask()
    for _ in stage.steps(answer):
        pass
    view = LiveView.decode(answer.result().payload)
    assert difference(view.picture, np.full((30, 40, 3), view.steps)) < 2


def test_an_actor_that_cannot_render_plays_on(
    hub: Transport, client: Transport, capsys: pytest.CaptureFixture[str]
) -> None:
    env = Rendering([GOES_ON])
    env.fault = RuntimeError("no display")
    stage = Stage(hub, client, env)
    for _ in range(2):
        answer = stage.ask()
        for _ in stage.steps(answer):
            pass
        view = LiveView.decode(answer.result().payload)
        assert view.picture == b""
        assert decoded(view.frame).shape == (84, 84, 3)
    told = capsys.readouterr().err
    assert told.startswith("a: no picture is shown: render() of the environment ")
    assert "RuntimeError('no display'), " in told
    assert told.count("no picture") == 1


def test_an_actor_whose_robot_cannot_be_seen_from_outside_plays_on(
    hub: Transport,
    client: Transport,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def no_view(*_: object, **__: object) -> None:
        raise OSError("the camera in the room is unplugged")

    env = RobotEnv(play=PLAY)
    monkeypatch.setattr(env.robot, "view", no_view)
    stage = Stage(hub, client, env)
    answer = stage.ask(viewpoint="room")
    for _ in stage.steps(answer):
        pass
    view = LiveView.decode(answer.result().payload)
    assert view.room == b""
    assert decoded(view.picture).shape == (240, 320, 3)
    assert "a: no picture is shown: the camera in the room" in capsys.readouterr().err
    env.close()


def test_nothing_is_drawn_while_nobody_looks(
    hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[NDArray[np.uint8] | None] = []
    encode = live_views._jpeg

    def note(picture: NDArray[np.uint8] | None) -> bytes:
        drawn.append(picture)
        return encode(picture)

    monkeypatch.setattr(live_views, "_jpeg", note)
    stage = Stage(hub, client, NumberedEnv([GOES_ON]))
    stage.policy.epsilon = 1.0
    never: Future[Envelope] = Future()
    for _, _ in zip(stage.steps(never), range(200), strict=False):
        pass
    assert drawn == []
    monkeypatch.setattr(live_views, "_PERIOD", float("inf"))
    for _ in stage.steps(stage.ask()):
        pass
    assert len(drawn) == 3  # picture, frame, room
    # However many ask: one look in a while.
    for _, _ in zip(stage.steps(stage.ask()), range(200), strict=False):
        pass
    assert len(drawn) == 3


def test_whoever_watches_takes_a_tenth_of_the_time_at_most(
    hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SimpleNamespace(now=100.0)
    clock.monotonic = lambda: clock.now
    encode = live_views._jpeg

    def slow(picture: NDArray[np.uint8] | None) -> bytes:
        clock.now += 1.0  # for each of three pictures
        return encode(picture)

    monkeypatch.setattr(live_views, "time", clock)
    monkeypatch.setattr(live_views, "_jpeg", slow)
    monkeypatch.setattr(live_views, "_REST", 9.0)
    stage = Stage(hub, client, NumberedEnv([GOES_ON]))
    stage.policy.epsilon = 1.0
    for _ in stage.steps(stage.ask()):
        pass
    assert clock.now == 103.0
    clock.now += 26.9
    again = stage.ask()
    for _, _ in zip(stage.steps(again), range(100), strict=False):
        pass
    assert clock.now == 129.9
    clock.now += 0.2
    for _ in stage.steps(again):
        pass
    assert clock.now == pytest.approx(133.1)


def test_what_cannot_be_shown_is_refused(hub: Transport, client: Transport) -> None:
    stage = Stage(hub, client, NumberedEnv([GOES_ON]))
    with pytest.raises(MessageError, match="there are 1 environments"):
        stage.ask(stream=1).result(PATIENCE)
    asked = [stage.ask() for _ in range(9)]
    with pytest.raises(MessageError, match="too many"):
        asked[-1].result(PATIENCE)


def test_a_picture_fits_whatever_it_shows() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (1_200, 1_600, 3), np.uint8)
    small = live_views._jpeg(noise)
    assert 0 < len(small) <= MAX_PICTURE_BYTES
    assert decoded(small).shape == (480, 640, 3)


def test_whoever_no_longer_waits_keeps_nobody_from_looking(
    hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SimpleNamespace(now=100.0)
    clock.monotonic = lambda: clock.now
    monkeypatch.setattr(live_views, "time", clock)
    stage = Stage(hub, client, NumberedEnv([GOES_ON]))
    gone = [stage.ask() for _ in range(9)]
    with pytest.raises(MessageError, match="too many"):
        gone[-1].result(PATIENCE)
    clock.now += VIEW_SECONDS
    answer = stage.ask()  # while it does not play, such as between two tests
    for _ in stage.steps(answer):
        pass
    assert LiveView.decode(answer.result().payload).streams == 1
    assert not any(each.done() for each in gone[:-1])

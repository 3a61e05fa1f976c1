"""The eye knows which of the game's pictures its own shows, before a camera that is late."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from actors.envs import eye as eye_module
from actors.envs import sight_check
from actors.envs.eye import Eye
from actors.robots.room.sensor import Sensor
from actors.vision.screen_detector import Detection
from common.settings.conditions import CameraConfig

SHAPE = (84, 84)


class Scene:
    """An eye before a screen that is grey all over, and sees it as it is, but late."""

    def __init__(self, latency: int, monkeypatch: pytest.MonkeyPatch) -> None:
        self.grey = 0
        self.frozen: np.ndarray | None = None
        camera = CameraConfig(latency=latency)
        self.sensor = sensor = Sensor(camera, SHAPE)
        sensor.begin_game(np.random.default_rng(0))
        emulator: Any = SimpleNamespace(screen_rgb=lambda: np.full(SHAPE, self.grey, np.uint8))
        game: Any = SimpleNamespace(emulator=emulator, conditions=SimpleNamespace(camera=camera))
        robot: Any = SimpleNamespace(
            camera_picture=lambda screen, passed: (
                sensor.take(screen, passed) if self.frozen is None else self.frozen
            )
        )

        def detector(distortion: float) -> Any:
            return SimpleNamespace(detect=lambda picture: Detection(picture, True, None))

        monkeypatch.setattr(eye_module, "ScreenDetector", detector)
        monkeypatch.setattr(sight_check, "frame_of", lambda screen: screen)
        monkeypatch.setattr(sight_check, "_PERIOD", 1)
        self.eye = Eye(robot, game, "camera")
        self.eye.begin_game()

    def look(self, grey: int, agent_steps: int) -> int:
        """Returns the grey that is seen."""
        self.grey = grey
        return int(self.eye.look(agent_steps)[0, 0])


@pytest.mark.parametrize("latency", [0, 1, 2, 3])
@pytest.mark.parametrize("agent_steps", [1, 2, 3])
def test_a_late_eye_follows_a_game_of_which_it_missed_agent_steps(
    latency: int, agent_steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in real time on a busy machine. The game moves, stands still, and moves again."""
    scene = Scene(latency, monkeypatch)
    greys = [9, 9, 9, 20, 20, 20, 20, 20, 33, 34, 35, 35, 35, 35, 35, 48]
    seen = []
    for grey in greys:
        seen.append(scene.look(grey, agent_steps))
        assert scene.eye.follows
    looks = -(-latency // agent_steps)
    assert seen[looks:] == greys[: len(greys) - looks]


@pytest.mark.parametrize("agent_steps", [1, 2])
def test_a_frozen_eye_does_not_follow(agent_steps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene(2, monkeypatch)
    for grey in range(5):
        scene.look(10 + grey, agent_steps)
    scene.frozen = scene.eye.picture
    follows = []
    for grey in (50, 51, 52, 52, 52, 52, 52):
        scene.look(grey, agent_steps)
        follows.append(scene.eye.follows)
    moves = 5 if agent_steps == 1 else 4  # looks until the still picture would be seen
    assert follows == [False] * moves + [True] * (7 - moves)


def test_pictures_between_two_looks_are_late_by_their_own_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = Scene(2, monkeypatch)
    for grey in range(3, 90, 3):
        scene.grey = grey
        scene.eye.wait(1)
        scene.grey = grey + 1
        scene.eye.wait(1)
        seen = scene.look(grey + 2, 1)
        assert scene.eye.follows
        assert seen == grey


def test_a_later_picture_of_the_same_moment_takes_the_place_of_the_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = Scene(1, monkeypatch)
    scene.look(10, 1)
    for grey in (20, 30, 40):
        scene.look(grey - 1, 1)
        scene.grey = grey
        scene.eye.wait(0)
        assert [moment for moment, _ in scene.eye._shown] == sorted(
            {moment for moment, _ in scene.eye._shown}
        )


def test_a_new_game_shows_nothing_of_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene(3, monkeypatch)
    for grey in range(10, 15):
        scene.look(grey, 1)
    scene.sensor.begin_game(np.random.default_rng(1))
    scene.eye.begin_game()
    assert (scene.look(90, 1), scene.eye.follows) == (90, True)
    assert [int(screen[0, 0]) for _, screen in scene.eye._shown] == [90]

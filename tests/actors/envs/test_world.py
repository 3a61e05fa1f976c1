"""The order in which controller, arms and game take turns, on stubs that keep a diary."""

import pytest

from actors.envs.world import World
from common.actions import KEYS_OF_ACTION, Keys, action_of_keys
from common.settings.conditions import PlayConfig

UP, FIRE = Keys.UP, Keys.FIRE


class ScriptedRoom:
    """Its hands press, frame by frame, what the script says."""

    def __init__(self, script: list[Keys], diary: list[str]) -> None:
        self.held = Keys.NONE
        self._script = iter(script)
        self._diary = diary

    def rest(self) -> None:
        self.held = Keys.NONE

    def command(self, keys: Keys) -> None:
        self._diary.append(f"command {keys:d}")

    def step_frame(self) -> Keys:
        self._diary.append("physics")
        self.held = next(self._script)
        return self.held


class DiaryGame:
    """Each frame makes as many points as its action's number."""

    def __init__(self, diary: list[str]) -> None:
        self._diary = diary

    def hold(self, action: int) -> float:
        self._diary.append(f"game {action}")
        return float(action)

    def end_agent_step(self) -> tuple[bool, bool]:
        return False, False


SCRIPT = [Keys.NONE, FIRE, FIRE, FIRE, FIRE, Keys.NONE, UP, UP]
"""Keys pressed in each frame of two agent steps."""


def world(play: PlayConfig, diary: list[str], script: list[Keys] = SCRIPT) -> World:
    return World(ScriptedRoom(script, diary), DiaryGame(diary), play)  # type: ignore[arg-type]


def test_by_default_each_frame_plays_what_is_pressed_at_the_end_of_its_physics() -> None:
    diary: list[str] = []
    playing = world(PlayConfig(), diary)
    playing.command(1)
    first, second = playing.finish_agent_step(), playing.finish_agent_step()
    actions = [action_of_keys(keys) for keys in SCRIPT]
    assert diary == [
        "command 16",
        *(line for action in actions for line in ("physics", f"game {action}")),
    ]
    assert (first.points, first.pressed) == (3.0, FIRE)
    assert (second.points, second.pressed) == (1.0 + 0.0 + 2.0 + 2.0, UP)


def test_in_the_papers_order_an_agent_step_plays_what_was_pressed_before_the_arms_moved() -> None:
    diary: list[str] = []
    playing = world(PlayConfig(read_keys="decision"), diary)
    playing.command(1)
    first = playing.finish_agent_step()
    assert diary == ["command 16", *["physics", "game 0"] * 4]
    assert (first.points, first.pressed) == (0.0, Keys.NONE)
    diary.clear()
    second = playing.finish_agent_step()
    assert diary == ["physics", "game 1"] * 4
    assert (second.points, second.pressed) == (4.0, FIRE)


@pytest.mark.parametrize("frame_skip", [1, 3, 4])
def test_an_agent_step_is_as_long_as_its_frames(frame_skip: int) -> None:
    diary: list[str] = []
    playing = world(PlayConfig(frame_skip=frame_skip), diary, [UP] * 12)
    for _ in range(12 // frame_skip):
        assert playing.finish_agent_step().points == 2.0 * frame_skip
    assert diary.count("physics") == 12


@pytest.mark.parametrize("keys", [Keys(bits) for bits in range(32)])
def test_any_keys_play_the_action_they_stand_for(keys: Keys) -> None:
    """Opposite ones cancel, as on the console's stick."""
    diary: list[str] = []
    world(PlayConfig(frame_skip=1), diary, [keys]).frame()
    for pair in (Keys.UP | Keys.DOWN, Keys.LEFT | Keys.RIGHT):
        keys = keys & ~pair if keys & pair == pair else keys
    assert diary[-1] == f"game {KEYS_OF_ACTION.index(keys)}"

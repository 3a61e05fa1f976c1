"""Plans by models whose keys are known by hand, and against the model itself, step by step."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from actors.envs import make_env
from actors.envs.ale import AtariEnv
from actors.envs.command_plan import _OPEN, CommandPlan
from actors.envs.late_commands import LateCommands
from actors.envs.latency_equaliser import LatencyEqualiser
from actors.robots.interface import Hands
from actors.robots.latency_model.model import LatencyModel
from actors.robots.latency_model.weights import ModelWeights
from common.actions import KEYS_OF_ACTION, Keys, action_of_keys
from common.errors import InputError
from common.pinned_file import pin
from common.run.conditions import PlayConfig
from common.run.presets import PRESETS
from tests.actors.envs.test_latency_equaliser import play, schedule
from tests.actors.robots.latency_model.models import Arrays, delay, drawn, plain, saved

EQUAL, GAP = 12, 4
PONG = (0, 1, 3, 4, 11, 12)
ACTIONS = st.lists(st.sampled_from(PONG), min_size=1, max_size=25)
RIGHT, LEFT = 3, 4


def weights(arrays: Arrays) -> ModelWeights:
    return ModelWeights(**arrays)  # type: ignore[arg-type]


def turning() -> Arrays:
    """Hands that press and release after 3 frames, but after 6 if they held the other direction in
    the last 6 frames: the arm turns slowly.

    A hidden unit for each direction and way; the quick one is off for the rest of a turn.
    """
    fc_weight = np.zeros((4, 30, 36), np.float32)
    pred_weight = np.zeros((18, 4), np.float32)
    for unit, (action, other) in enumerate([(RIGHT, LEFT), (LEFT, RIGHT)]):
        fc_weight[unit, 29 - 3, action] = 1
        fc_weight[unit, 30 - 6 :, 18 + other] = -1
        fc_weight[2 + unit, [29 - 3, 29 - 6], action] = 1
        pred_weight[action, [unit, 2 + unit]] = 2
    pred_bias = np.full(18, -1, np.float32)
    pred_bias[0] = 0.5
    return {
        "fc_weight": fc_weight.reshape(4, 1080),
        "fc_bias": np.array([0, 0, -1, -1], np.float32),
        "pred_weight": pred_weight,
        "pred_bias": pred_bias,
    }


def equal(
    arrays: Arrays,
    hands: Callable[[LatencyModel], Hands] = lambda model: model,
    at: int = EQUAL,
    gap: int = GAP,
    *,
    planned: bool = True,
) -> LatencyEqualiser:
    own = hands(LatencyModel(weights(arrays), 60))
    made = LatencyEqualiser(own, at, gap, plan=CommandPlan(weights(arrays)) if planned else None)
    made.time(~Keys.NONE)
    made.rest()
    return made


@settings(max_examples=25)
@given(st.integers(0, 8), ACTIONS, st.integers(0, 4))
@example(8, [3, 4, 0, 4, 0, 0, 4, 11, 12, 1, 0, 1], 4)
@example(0, [3, 4, 3, 0, 1], 0)
@example(0, [1, 3, 0, 0], 3)
def test_hands_of_one_latency_keep_the_schedule(own: int, actions: list[int], gap: int) -> None:
    assert play(equal(delay(own), gap=gap), actions) == schedule(actions, EQUAL, gap=gap)


TURNS = [0, 3, 3, 3, 4, 4, 4, 0, 0, 0, 4, 4, 3, 3, 3, 3, 0, 0, 0, 3, 3, 4, 4, 4, 4]


def test_slow_turns_are_commanded_sooner() -> None:
    """Keys are timed one by one, and none is slow by itself."""
    assert play(equal(turning()), TURNS) == schedule(TURNS, EQUAL, gap=GAP)
    assert play(equal(turning(), planned=False), TURNS) != schedule(TURNS, EQUAL, gap=GAP)


@pytest.mark.parametrize("late", [1, 5, 20])
def test_the_way_of_commands_is_timed_and_planned_for(late: int) -> None:
    def far(model: LatencyModel) -> Hands:
        return LateCommands(model, late, 0, np.random.default_rng(0))

    at = EQUAL + late
    assert play(equal(turning(), far, at), TURNS) == schedule(TURNS, at, gap=GAP)


def test_pictures_that_come_late_leave_less_time() -> None:
    late = equal(turning())
    late.seen_late = 3
    assert play(late, TURNS) == schedule(TURNS, EQUAL - 3, gap=GAP)


def test_a_game_begins_without_commands() -> None:
    again = equal(turning())
    play(again, TURNS)
    again.rest()
    assert play(again, TURNS) == schedule(TURNS, EQUAL, gap=GAP)


class Stuck(LatencyModel):
    """Hands that hold on to their keys from frame 30 on, for 8 frames."""

    frame = 0

    def step_frame(self) -> Keys:
        self.frame += 1
        if not 30 < self.frame <= 38:
            return super().step_frame()
        self._past.append((self._wanted, 18 + self._taken))
        return self.held

    def rest(self) -> None:
        super().rest()
        self.frame = 0


def test_hands_that_do_something_else_are_planned_for_as_they_are() -> None:
    stuck = LatencyEqualiser(
        Stuck(weights(turning()), 60), EQUAL, GAP, plan=CommandPlan(weights(turning()))
    )
    stuck.time(~Keys.NONE)
    stuck.rest()
    found, due = play(stuck, TURNS), schedule(TURNS, EQUAL, gap=GAP)
    assert found[:30] == due[:30]
    assert found[30:38] == [due[29]] * 8
    assert due[29] != due[37]
    assert found[50:] == due[50:]


SEQUENCES = st.lists(
    st.lists(st.sampled_from(PONG), min_size=_OPEN, max_size=_OPEN), min_size=1, max_size=4
)


@settings(max_examples=40)
@given(st.integers(0, 5), st.lists(st.sampled_from(PONG), max_size=40), SEQUENCES)
def test_what_is_foreseen_is_what_the_model_does(
    seed: int, told: list[int], sequences: list[list[int]]
) -> None:
    arrays = drawn(7, seed)
    plan = CommandPlan(weights(arrays))
    taken = [0, *plain(arrays, told)]
    for command, held in zip(told, taken[1:], strict=True):
        plan._given = np.append(plan._given[1:], command)
        plan._held = np.append(plan._held[1:], held)
    choices, which = np.unique(np.array(sequences), return_inverse=True)
    which = which.reshape(len(sequences), _OPEN)
    found = plan._simulate(choices, which, np.empty((len(sequences), 0), np.int64))
    for sequence, foreseen in zip(sequences, found.tolist(), strict=True):
        lasting = [*sequence, *[sequence[-1]] * (plan.frames - _OPEN)]
        assert foreseen == plain(arrays, [*told, *lasting])[len(told) :]


def wrong_frames(model: LatencyModel, commands: list[int], wanted: list[int]) -> int:
    """In how many frames the model holds something else after such commands."""
    own, wrong = deepcopy(model), 0
    for command, goal in zip(commands, wanted, strict=True):
        own.command(KEYS_OF_ACTION[command])
        wrong += own.step_frame() != KEYS_OF_ACTION[goal]
    return wrong


@settings(max_examples=40)
@given(
    st.integers(0, 3),
    st.lists(st.sampled_from(PONG), max_size=12),
    st.lists(st.sampled_from((0, RIGHT, LEFT)), min_size=30, max_size=30),
)
def test_no_other_sequence_that_is_compared_is_better(
    seed: int, told: list[int], wanted: list[int]
) -> None:
    """Tried one by one on the model itself; all frames are sure."""
    arrays = drawn(5, seed)
    plan, model = CommandPlan(weights(arrays)), LatencyModel(weights(arrays), 60)
    for command in told:
        plan._given = np.append(plan._given[1:], command)
        model.command(KEYS_OF_ACTION[command])
        plan._held = np.append(plan._held[1:], action_of_keys(model.step_frame()))
    goal = (wanted * 2)[: plan.frames]
    before = deepcopy(model)
    first = plan.command(goal, plan.frames)
    chosen = [first, *plan._sequence.tolist()]
    lasting = [chosen[-1]] * plan.frames
    best = wrong_frames(before, [*chosen, *lasting][: plan.frames], goal)
    choices = list(dict.fromkeys([told[-1] if told else 0, *goal[plan._soonest :]]))[:3]
    for a in choices:
        for b in choices:
            for change in range(_OPEN):
                other = [a] * change + [b] * (plan.frames - change)
                assert best <= wrong_frames(before, other, goal)


def test_of_equally_good_sequences_the_calmest_is_taken() -> None:
    plan, told = CommandPlan(weights(delay(2))), []
    for frame in range(40):
        goal = [RIGHT if 20 <= frame + ahead < 30 else 0 for ahead in range(plan.frames)]
        told.append(plan.command(goal, plan.frames))
        plan.feel(([0, 0, *told])[frame])
    assert [key for key, _ in groupby(told)] == [0, RIGHT, 0]
    assert told[18:28] == [RIGHT] * 10


def test_the_model_of_other_hands_is_refused() -> None:
    other = LatencyEqualiser(
        LatencyModel(weights(delay(1)), 60), EQUAL, GAP, plan=CommandPlan(weights(delay(9)))
    )
    with pytest.raises(InputError, match=r"a key 8 frames sooner than by play.hands_model"):
        other.time(~Keys.NONE)


def test_an_environment_plans_by_the_file_of_its_settings(tmp_path: Path) -> None:
    file = saved(tmp_path / "m.npz", turning())
    own = PlayConfig(
        robot=file, robot_settings="rate=60", minimal_actions=True, random_starts=0,
        equal_latency=EQUAL, equal_gap=GAP, hands_model=file, vector=True,
    )  # fmt: skip
    config = replace(PRESETS["fast"], play=own).pinned()
    assert config.play.hands_model == config.play.robot == pin(file)
    env = make_env(config, training=False)
    assert isinstance(env, AtariEnv)
    env.reset(seed=1)
    felt = []
    for action in TURNS:
        observation, *_ = env.step(env.actions.index(action))
        assert isinstance(observation, dict)
        felt.append(env.pressed)
    assert felt == schedule(TURNS, EQUAL, gap=GAP)[3::4]
    env.close()
    saved(tmp_path / "m.npz", delay(1))
    with pytest.raises(InputError, match="is not the run's"):
        make_env(config, training=False)

"""Plans by models whose keys are known by hand, and against the model itself, step by step."""

from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import replace
from itertools import combinations_with_replacement, groupby, pairwise, product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from actors.envs import make_env
from actors.envs.ale import AtariEnv
from actors.envs.command_plan import CommandPlan
from actors.envs.hand_timing import HandLatency
from actors.envs.late_commands import LateCommands
from actors.envs.latency_equaliser import LatencyEqualiser
from actors.robots.interface import Hands
from actors.robots.latency_model.model import LatencyModel
from actors.robots.latency_model.weights import ModelWeights
from common.actions import KEYS_OF_ACTION, Keys, action_of_keys
from common.errors import InputError
from common.pinned_file import pin
from common.settings.conditions import PlayConfig
from common.settings.presets import PRESETS
from tests.actors.envs.test_latency_equaliser import play, schedule
from tests.actors.robots.latency_model.models import Arrays, delay, drawn, plain, saved, together

EQUAL, GAP = 12, 4
OPEN = 6
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
    own = hands(LatencyModel([weights(arrays)], 60))
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
        Stuck([weights(turning())], 60), EQUAL, GAP, plan=CommandPlan(weights(turning()))
    )
    stuck.time(~Keys.NONE)
    stuck.rest()
    found, due = play(stuck, TURNS), schedule(TURNS, EQUAL, gap=GAP)
    assert found[:30] == due[:30]
    assert found[30:38] == [due[29]] * 8
    assert due[29] != due[37]
    assert found[50:] == due[50:]


SEQUENCES = st.lists(
    st.lists(st.sampled_from(PONG), min_size=OPEN, max_size=OPEN), min_size=1, max_size=4
)


@settings(max_examples=40)
@given(st.integers(0, 5), st.lists(st.sampled_from(PONG), max_size=40), SEQUENCES)
@example(0, [], [[0, 0, 0, 0, 4, 0]])
def test_what_is_foreseen_is_what_the_model_does(
    seed: int, told: list[int], sequences: list[list[int]]
) -> None:
    # Of eighths, sums are exact in the plan's float32 too, so that no tie is decided otherwise.
    arrays = {
        name: (np.rint(8 * each) / 8).astype(np.float32) for name, each in drawn(7, seed).items()
    }
    plan = CommandPlan(weights(arrays))
    taken = [0, *plain(arrays, told)]
    for command, held in zip(told, taken[1:], strict=True):
        plan._given = np.append(plan._given[1:], command)
        plan._held = np.append(plan._held[1:], held)
    choices, which = np.unique(np.array(sequences), return_inverse=True)
    which = which.reshape(len(sequences), OPEN)
    found = plan._simulate(choices, which, np.empty((len(sequences), 0), np.int64))
    for sequence, foreseen in zip(sequences, found.tolist(), strict=True):
        lasting = [*sequence, *[sequence[-1]] * (plan.frames - OPEN)]
        assert foreseen == plain(arrays, [*told, *lasting])[len(told) :]


def price(hands: Hands, commands: list[int], goal: list[int], sure: int, before: int) -> float:
    """What hands cost that hold something else than the goal after such commands, tried on them
    step by step: a frame that is sure 1, another 0.25, each 1 % less than the one before it, and a
    change of command 0.01."""
    own, cost = deepcopy(hands), 0.0
    for frame, wanted in enumerate(goal):
        own.command(KEYS_OF_ACTION[commands[min(frame, OPEN - 1)]])
        if own.step_frame() != KEYS_OF_ACTION[wanted]:
            cost += (1 if frame < sure else 0.25) * 0.99**frame
    return cost + 0.01 * sum(a != b for a, b in pairwise([before, *commands]))


def calm(choices: list[int]) -> Iterator[list[int]]:
    """All sequences of the choices with at most two changes."""
    for a, b, c in product(choices, repeat=3):
        for i, j in combinations_with_replacement(range(OPEN + 1), 2):
            yield [a] * i + [b] * (j - i) + [c] * (OPEN - j)


@settings(max_examples=20, deadline=None)
@given(
    st.sampled_from([turning(), drawn(5, 1), drawn(5, 2)]),
    st.sampled_from([0, 0, 3]),
    st.lists(st.sampled_from(PONG), max_size=12),
    st.lists(st.sampled_from(PONG), min_size=30, max_size=30),
    st.integers(0, 12),
    st.sampled_from((None, 0, RIGHT)),
)
def test_no_other_sequence_that_is_compared_is_better(
    arrays: Arrays,
    late: int,
    told: list[int],
    wanted: list[int],
    sure: int,
    surprise: int | None,
) -> None:
    """For two frames in turn: in the second, the sequence of the first is compared as well, and
    the hands may have done something else than the model in the first."""
    plan, model = CommandPlan(weights(arrays)), LatencyModel([weights(arrays)], 60)
    hands = LateCommands(model, late, 0, np.random.default_rng(0))
    plan._late = late
    plan.rest()
    for command in told:
        plan._given = np.append(plan._given[1:], command)
        hands.command(KEYS_OF_ACTION[command])
        plan._held = np.append(plan._held[1:], action_of_keys(hands.step_frame()))
    goals, before, former = wanted * 2, told[-1] if told else 0, [0] * OPEN
    for frame in range(2):
        goal = goals[frame : frame + plan.frames]
        reached = goal[min(late + plan._soonest, len(goal) - 1) :]
        choices = list(dict.fromkeys([before, *reached]))[:3]
        others = [*former[1:], former[-1]]
        as_it_is = deepcopy(hands)
        first = plan.command(goal, sure)
        chosen = [first, *plan._sequence[:-1].tolist()]
        cost = price(as_it_is, chosen, goal, sure, before)
        best = min(price(as_it_is, other, goal, sure, before) for other in [others, *calm(choices)])
        assert cost <= best + 1e-6 or price(as_it_is, others, goal, len(goal), others[0]) < 0.25
        hands.command(KEYS_OF_ACTION[first])
        hands.step_frame()
        if surprise is not None:
            hands._hands._taken = surprise  # type: ignore[attr-defined]
        plan.feel(action_of_keys(hands.held))
        before, former = first, chosen


def test_after_rest_it_is_as_new() -> None:
    def commands(plan: CommandPlan) -> list[int]:
        found, held = [], plain(drawn(5, 2), [*PONG] * 4)
        for frame, now in enumerate(held):
            goal = [(RIGHT, 0, LEFT)[(frame + ahead) // 5 % 3] for ahead in range(plan.frames)]
            found.append(plan.command(goal, plan.frames))
            plan.feel(now)
        return found

    used = CommandPlan(weights(drawn(5, 1)))
    first = commands(used)
    assert len(set(first)) == 3
    assert commands(used) != first
    used.rest()
    assert commands(used) == first


class StubPlan(CommandPlan):
    """Keeps what it is told."""

    def rest(self) -> None:
        super().rest()
        self.asked: list[tuple[list[int], int]] = []
        self.felt: list[int] = []

    def command(self, wanted: Sequence[int], sure: int) -> int:
        self.asked.append((list(wanted), sure))
        return super().command(wanted, sure)

    def feel(self, held: int) -> None:
        self.felt.append(held)
        super().feel(held)


def test_it_is_told_the_schedule_what_is_sure_and_what_is_held() -> None:
    plan = StubPlan(weights(turning()))
    hands = LatencyEqualiser(Stuck([weights(turning())], 60), EQUAL, GAP, plan=plan)
    hands.time(~Keys.NONE)
    hands.rest()
    hands.seen_late = 2
    found = play(hands, TURNS)
    assert [KEYS_OF_ACTION[held] for held in plan.felt] == found
    due = [action_of_keys(keys) for keys in schedule(TURNS, EQUAL - 2, gap=GAP)]
    for frame, (wanted, sure) in enumerate(plan.asked[:-20]):
        assert sure == EQUAL - 2 + 1
        assert len(wanted) == plan.frames == 3 + OPEN
        # Here commands change with each agent step at the soonest.
        assert wanted[:sure] == due[frame : frame + sure][: len(wanted)]


def test_a_planned_command_is_timed_from_when_the_agent_gave_it() -> None:
    """From the first command of what is pressed then, or is not held any more."""
    moments: list[int] = []
    plan = CommandPlan(weights(turning()))
    hands = LatencyEqualiser(
        LatencyModel([weights(turning())], 60),
        EQUAL,
        GAP,
        lambda ago: moments.append(now - ago),
        plan,
    )
    now = 0
    hands.time(~Keys.NONE)
    hands.rest()
    moments.clear()
    for now in range(80):
        hands.command(Keys.RIGHT if 3 <= now < 23 else Keys.LEFT if 23 <= now < 43 else Keys.NONE)
        hands.step_frame()
    # RIGHT, away from it, LEFT, nothing. LEFT sets out 6 frames before it is due.
    assert set(moments) == {3, 23, 43}
    assert moments == sorted(moments)


def test_of_equally_good_sequences_the_calmest_is_taken() -> None:
    plan, told = CommandPlan(weights(delay(2))), []
    for frame in range(40):
        goal = [RIGHT if 20 <= frame + ahead < 30 else 0 for ahead in range(plan.frames)]
        told.append(plan.command(goal, plan.frames))
        plan.feel(([0, 0, *told])[frame])
    assert [key for key, _ in groupby(told)] == [0, RIGHT, 0]
    assert told[18:28] == [RIGHT] * 10


def by_model_of(own: int, model: int) -> LatencyEqualiser:
    plan = CommandPlan(weights(delay(model)))
    return LatencyEqualiser(LatencyModel([weights(delay(own))], 60), EQUAL, GAP, plan=plan)


def test_the_model_of_other_hands_is_refused() -> None:
    by_model_of(1, 4).time(~Keys.NONE)
    with pytest.raises(InputError, match=r"a key 4 frames sooner than by play.hands_model"):
        by_model_of(1, 5).time(~Keys.NONE)


def test_the_quickest_key_tells_the_way_of_the_commands() -> None:
    plan = CommandPlan(weights(delay(3)))
    plan.time({Keys.UP: HandLatency(9, 9, 9), Keys.RIGHT: HandLatency(5, 5, 5)})
    assert plan.frames == 3 + OPEN + 2
    plan.time({})
    assert plan.frames == 3 + OPEN


def test_a_model_that_never_presses_a_key_is_asked_for_nothing() -> None:
    plan = CommandPlan(weights({name: np.zeros_like(each) for name, each in delay(0).items()}))
    plan.time({Keys.UP: HandLatency(2, 2, 2)})
    assert plan.command([RIGHT] * plan.frames, plan.frames) == 0


def test_commands_that_come_too_late_to_be_timed_are_not_taken_for_the_next_ones() -> None:
    """Only their jitter makes them so late, and only sometimes."""
    model = LatencyModel([weights(delay(9))], 60)
    hands = LateCommands(model, 36, 36, np.random.default_rng(3))
    plan = CommandPlan(weights(delay(9)))
    far = LatencyEqualiser(hands, 36, GAP, plan=plan)
    for _ in range(12):
        far.time(~Keys.NONE)
        assert plan.frames >= 36 + 9 + OPEN


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


def test_several_copies_cannot_be_planned_for(tmp_path: Path) -> None:
    file = saved(tmp_path / "m.npz", together(delay(2), delay(3)))
    with pytest.raises(InputError, match=r"m\.npz holds 2 copies of the hands where one is needed"):
        CommandPlan.of_play(PlayConfig(hands_model=pin(file)))
    one = saved(tmp_path / "one.npz", delay(3))
    with pytest.raises(InputError, match=r"m\.npz holds 2 copies of the hands where one is needed"):
        CommandPlan.of_play(PlayConfig(robot=pin(file), hands_model=pin(one)))

"""The acting loop: who is asked when, and what is handed on."""

from itertools import count, islice

import numpy as np
from numpy.typing import NDArray

from actors.envs.step_info import StepInfo
from actors.loop import Step, play
from actors.policy import Policy
from common.network import QNetwork
from tests.actors.numbered_env import CUT, GAME_OVER, GOES_ON, LOSES_A_LIFE, NumberedEnv


class Recorder(Policy):
    """Acts 0, 1, 2 …, says that odd actions are random, and remembers what it was shown."""

    def __init__(self) -> None:
        super().__init__(QNetwork(6), 6, np.random.default_rng(0))
        self.shown: list[NDArray[np.uint8]] = []

    def act(self, frames: NDArray[np.uint8], vectors: NDArray[np.float32]) -> NDArray[np.int64]:
        assert vectors.shape == (len(frames), 0)
        self.shown.append(frames.copy())
        actions = (np.arange(len(frames)) + len(self.shown) * len(frames)) % 6
        self.explored = actions % 2 == 1
        return actions


def lived(envs: list[NumberedEnv], steps: int, policy: Policy) -> list[Step]:
    """The first steps, each with states of its own."""
    return [
        step._replace(s_tm1=step.s_tm1.copy(), s_t=step.s_t.copy())
        for step in islice(play(envs, policy, list(range(100, 100 + len(envs)))), steps)
    ]


def test_environments_take_turns_and_steps_say_what_happened() -> None:
    scripts = (
        [GOES_ON, GOES_ON, LOSES_A_LIFE],
        [GAME_OVER],
        [GOES_ON, CUT, GOES_ON, GOES_ON, GAME_OVER],
    )
    envs = [NumberedEnv(script, first=1_000 * i) for i, script in enumerate(scripts)]
    steps = lived(envs, 60, Recorder())
    assert [step.stream for step in steps] == [0, 1, 2] * 20
    for at, step in enumerate(steps):
        moment = envs[step.stream].moments[at // 3]
        assert (step.s_tm1 == moment.state).all()
        assert (step.s_t == moment.next_state).all()
        assert step.begins == moment.begins
        assert step.valid == moment.valid
        assert step.a_tm1 == moment.action
        assert step.explored == (moment.action % 2 == 1)
        assert step.r_t == moment.reward
        assert step.terminated == (moment.ending in (LOSES_A_LIFE, GAME_OVER))
        assert step.truncated == (moment.ending == CUT)
        assert step.info == StepInfo(**moment.info)


def test_an_episode_begins_after_each_end_and_nowhere_else() -> None:
    env = NumberedEnv([GOES_ON, GOES_ON, GAME_OVER, CUT, LOSES_A_LIFE])
    begins = [step.begins for step in lived([env], 10, Recorder())]
    assert begins == [True, False, False, True, True] * 2


def test_only_the_first_reset_is_seeded() -> None:
    envs = [NumberedEnv([GOES_ON, GAME_OVER]) for _ in range(2)]
    lived(envs, 2 * 7, Recorder())
    assert envs[0].seeds == [100, None, None, None]
    assert envs[1].seeds == [101, None, None, None]


def test_each_reset_has_the_options_of_its_time() -> None:
    env, asked = NumberedEnv([GOES_ON, GAME_OVER]), count()
    steps = play([env], Recorder(), [1], lambda: {"number": next(asked)})
    assert len(list(islice(steps, 5))) == 5
    assert env.options == [{"number": 0}, {"number": 1}, {"number": 2}]


def test_the_policy_sees_the_newest_state_of_every_environment() -> None:
    envs = [NumberedEnv([GOES_ON, CUT]), NumberedEnv([GAME_OVER], first=500)]
    policy = Recorder()
    lived(envs, 2 * 9, policy)
    assert len(policy.shown) == 9
    for turn, shown in enumerate(policy.shown):
        for i, env in enumerate(envs):
            assert (shown[i] == env.moments[turn].state).all()


def test_a_step_has_the_version_and_epsilon_that_chose_its_action() -> None:
    policy = Recorder()
    policy.weights_version, policy.epsilon = 1, 0.5
    steps = play([NumberedEnv([GOES_ON]), NumberedEnv([GOES_ON])], policy, [1, 2])
    told = []
    for step in islice(steps, 4):
        told.append((step.stream, step.weights_version, step.epsilon))
        if step.stream == 0:  # new weights, between two environments whose actions are chosen
            policy.weights_version, policy.epsilon = policy.weights_version + 1, policy.epsilon / 2
    assert told == [(0, 1, 0.5), (1, 1, 0.5), (0, 2, 0.25), (1, 2, 0.25)]


def test_nothing_is_played_ahead_of_who_asks() -> None:
    envs = [NumberedEnv([GOES_ON]), NumberedEnv([GOES_ON])]
    steps = play(envs, Recorder(), [1, 2])
    assert [len(env.seeds) for env in envs] == [0, 0]
    next(steps)
    assert [len(env.moments) for env in envs] == [1, 0]
    next(steps)
    assert [len(env.moments) for env in envs] == [1, 1]


def test_vectors_go_beside_the_frames_to_the_policy_and_on() -> None:
    class Reader(Recorder):
        def __init__(self) -> None:
            super().__init__()
            self.vectors: list[NDArray[np.float32]] = []

        def act(self, frames: NDArray[np.uint8], vectors: NDArray[np.float32]) -> NDArray[np.int64]:
            self.vectors.append(vectors.copy())
            self.explored = np.ones(len(frames), np.bool_)
            return np.zeros(len(frames), np.int64)

    envs = [NumberedEnv([GOES_ON, CUT], width=3), NumberedEnv([GAME_OVER], first=500, width=3)]
    policy = Reader()
    for at, step in enumerate(islice(play(envs, policy, [0, 1]), 18)):
        moment = envs[at % 2].moments[at // 2]
        assert (step.x_tm1 == moment.vector).all()
        assert (step.x_t == moment.next_vector).all()
        assert (policy.vectors[at // 2][at % 2] == moment.vector).all()

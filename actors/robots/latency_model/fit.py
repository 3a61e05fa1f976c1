"""`python -m actors.robots.latency_model.fit`: a latency model of a robot's own hands.

Random commands go to the hands, and a `LatencyModel` learns which keys they hold in each emulator
frame. Learning by the model then needs no body: the emulator alone follows it. This is how Physical
Atari got the model of its robot (Keen Technologies 2026).
"""

import io
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from annotated_types import Ge, Le
from numpy.random import Generator
from numpy.typing import NDArray

from actors.robots.interface import Hands
from actors.robots.latency_model.model import LatencyModel
from actors.robots.latency_model.weights import ACTIONS, COMMANDS, MAX_HIDDEN, ROW, ModelWeights
from common.actions import KEYS_OF_ACTION, action_of_keys
from common.atomic_file import check_new_file, write_atomically
from common.checked import FromOne
from common.games import MINIMAL_ACTIONS, SCREEN_SHAPE, check_game
from common.process.command_line import parse
from common.process.program_end import exit_on_input_error
from common.process.progress import Progress
from common.registry import ROBOTS
from common.run.conditions import FRAMES_PER_SECOND, CameraConfig, PlayConfig
from common.run.own_settings import ROBOT, check_own_settings

_HELD = (1, 2, 4, 12)
"""Mean numbers of agent steps for which a command is held, one in each fourth of the steps: where
commands are long, hands come to rest; where they are short, each meets the one before."""
_TESTED = 0.1
"""Further steps on which the model is tested, as a share of those from which it learns."""
UPDATES = 3_000
_BATCH = 1_024
_LEARNING_RATE = 3e-3


@dataclass(frozen=True)
class FitOptions:
    """Learn a latency model of a robot's hands. It takes 60 commands per second (--robot FILE.npz
    --play.robot-settings rate=60)."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """File of the model, .npz."""
    robot: str = "nao"
    """Robot whose hands are measured: 'nao', 'robotroller', a registered one, or FILE.npz."""
    robot_settings: Annotated[str, tyro.conf.arg(name="play.robot-settings")] = ""
    """Settings that the robot declares for itself."""
    game: str = "pong"
    """Game whose own actions are commanded."""
    steps: FromOne = 20_000
    """Number of agent steps for which the hands are commanded; 20,000 are 22 minutes of a robot."""
    hidden: Annotated[int, Ge(1), Le(MAX_HIDDEN)] = 256
    """Number of hidden units."""
    seed: Annotated[int, Ge(0)] = 1
    """Seed of the commands and the first weights."""

    def check(self) -> None:
        """Refuses what cannot work. Raises InputError."""
        check_game(self.game)
        check_own_settings(ROBOTS.find(self.robot), self.robot_settings, ROBOT.text)
        check_new_file(self.output)


@dataclass(frozen=True)
class Recording:
    """What hands did in ``N`` emulator frames, as ALE's actions."""

    wanted: NDArray[np.int64]
    """``[N]``, the command in each frame."""
    held: NDArray[np.int64]
    """``[N]``, what was held at the end of each frame."""


def commands(actions: Sequence[int], steps: int, rng: Generator) -> Iterator[int]:
    """Yields the action of each agent step: each is held for a random time, of which `_HELD` gives
    the means."""
    action = actions[0]
    for step in range(steps):
        if rng.random() < 1 / _HELD[step * len(_HELD) // steps]:
            action = actions[int(rng.integers(len(actions)))]
        yield action


def record(hands: Hands, told: Iterator[int]) -> Recording:
    """Gives the hands each command for an agent step, and returns what they did."""
    hands.rest()
    wanted, held = [], []
    for action in told:
        hands.command(KEYS_OF_ACTION[action])
        for _ in range(PlayConfig.frame_skip):
            held.append(action_of_keys(hands.step_frame()))
            wanted.append(action)
    return Recording(np.array(wanted), np.array(held))


def inputs(recording: Recording) -> NDArray[np.int64]:
    """Returns the columns of the model's first layer that are 1 in each frame, ``[N, 60]``: the
    last 30 commands, and what was held just before each of them."""
    before = np.concatenate([[0], recording.held[:-1]])
    columns = np.stack([recording.wanted, ACTIONS + before], axis=1)
    nothing = np.tile([0, ACTIONS], (COMMANDS - 1, 1))
    past = np.lib.stride_tricks.sliding_window_view(
        np.concatenate([nothing, columns]), COMMANDS, axis=0
    )
    return (past + ROW * np.arange(COMMANDS)).reshape(len(columns), 2 * COMMANDS)


def fit(
    recording: Recording, hidden: int, seed: int, tell: Callable[[int], None] = lambda updates: None
) -> ModelWeights:
    """Returns the weights of the model by which the recorded frames are most likely.

    Args:
        tell: takes the number of updates, of `UPDATES`, that are done.
    """
    import torch  # late, for it takes seconds
    from torch import nn

    torch.set_num_threads(1)  # two that share a busy core wait for each other: 30 times as long
    torch.manual_seed(seed)
    first, second = nn.Linear(COMMANDS * ROW, hidden), nn.Linear(hidden, ACTIONS)
    nn.init.normal_(first.weight, std=(2 * COMMANDS) ** -0.5)  # 60 of its inputs are 1
    layers = nn.Sequential(first, nn.ReLU(), second)
    optimizer = torch.optim.Adam(layers.parameters(), lr=_LEARNING_RATE, fused=True)
    columns, held = torch.from_numpy(inputs(recording)), torch.from_numpy(recording.held)
    schedule = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.01, UPDATES)
    for update in range(UPDATES):
        chosen = torch.randint(len(held), (_BATCH,))
        x = torch.zeros(_BATCH, COMMANDS * ROW).scatter_(1, columns[chosen], 1.0)
        loss = nn.functional.cross_entropy(layers(x), held[chosen])
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        schedule.step()
        tell(update + 1)
    return ModelWeights(*(each.detach().double().numpy() for each in layers.parameters()))


def differing(weights: ModelWeights, recording: Recording) -> float:
    """Returns in which share of the recorded frames the model, by itself, holds other keys."""
    model = LatencyModel(weights, FRAMES_PER_SECOND)
    told = iter(recording.wanted[:: PlayConfig.frame_skip].tolist())
    return float((record(model, told).held != recording.held).mean())


def packed(weights: ModelWeights) -> bytes:
    """Returns the content of the model's file, in float32 as Physical Atari's."""
    content = io.BytesIO()
    arrays: dict[str, Any] = {name: each.astype(np.float32) for name, each in vars(weights).items()}
    np.savez(content, **arrays)
    return content.getvalue()


def run(options: FitOptions) -> None:
    """Measures, learns, tests and writes the model."""
    rng = np.random.default_rng(options.seed)
    play = PlayConfig(robot=options.robot, robot_settings=options.robot_settings)
    lengths = (options.steps, max(1, int(options.steps * _TESTED)))
    recordings: list[Recording] = []
    robot = ROBOTS.make(options.robot, SCREEN_SHAPE, CameraConfig(), play)
    with closing(robot), Progress("measuring", sum(lengths)) as progress:
        for steps in lengths:
            told = commands(MINIMAL_ACTIONS[options.game], steps, rng)
            recordings.append(record(robot, _shown(told, progress, len(recordings) * lengths[0])))
    learned, tested = recordings
    with Progress("learning", UPDATES) as progress:
        weights = fit(learned, options.hidden, options.seed, progress.update)
    write_atomically(options.output, packed(weights))
    changes = int((np.diff(tested.held) != 0).sum())
    print(
        f"wrote {options.output}: in {len(tested.held):,} other frames with {changes:,} changes of "
        f"keys, it holds other keys than {options.robot} in {differing(weights, tested):.2%}."
    )


def _shown(told: Iterator[int], progress: Progress, before: int) -> Iterator[int]:
    for done, action in enumerate(told, before):
        progress.update(done)
        yield action


def main() -> None:
    options = parse(FitOptions, "actors.robots.latency_model.fit", sys.argv[1:])
    options.check()
    run(options)


if __name__ == "__main__":
    exit_on_input_error(main)

"""`python -m actors.robots.latency_model.fit`: a latency model of a robot's own hands.

Random commands go to the hands, and a `LatencyModel` learns which keys they hold in each emulator
frame. Learning by the model then needs no body: the emulator alone follows it. This is how Physical
Atari got the model of its robot (Keen Technologies 2026).
"""

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
import tyro
from annotated_types import Ge, Le
from numpy.random import Generator

from actors.robots.interface import Hands
from actors.robots.latency import AGENT_STEP, hold
from actors.robots.latency_model.model import LatencyModel
from actors.robots.latency_model.recording import Recording, inputs
from actors.robots.latency_model.weights import (
    ACTIONS,
    COMMANDS,
    MAX_COPIES,
    MAX_HIDDEN,
    MAX_UNITS,
    ROW,
    ModelWeights,
    check_one_copy,
    write_copies,
)
from common.actions import KEYS_OF_ACTION, Keys, action_of_keys
from common.atomic_file import check_new_file
from common.checked import FromOne
from common.command_line.parser import parse
from common.counted import counted
from common.errors import InputError
from common.games import MINIMAL_ACTIONS, SCREEN_SHAPE, check_game
from common.pinned_file import pin
from common.process.extras import extra_for
from common.process.program_end import exit_on_input_error
from common.process.progress import Progress
from common.registry import ROBOTS
from common.settings.conditions import FRAMES_PER_SECOND, CameraConfig, PlayConfig
from common.settings.config import Seed
from common.settings.own_settings import ROBOT, check_own_settings

_HELD = (1, 2)
"""Mean numbers of agent steps for which a command is held, one in each half of the steps: as short
as those of a policy, which changes its command in most agent steps."""
_TESTED = 0.1
"""Further steps on which the model is tested, as a share of those from which it learns."""
_MANY, _GOOD = 200, 0.1
"""Changes of keys from which on a test tells something, and the share of wrong frames up to which a
copy is one of these hands: of 18,000 commands of Physical Atari's model, 1,456 and 0.06."""
_FEW = "that is no copy of these hands yet, or its test is too short: give more --steps.\n"
UPDATES = 3_000
_BATCH = 1_024
_LEARNING_RATE = 3e-3
T = TypeVar("T")


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
    recordings: tuple[Path, ...] = ()
    """Recordings of games that were played by these hands (`ale-robot record`, with --play.vector);
    the model learns from them too."""
    game: str = "pong"
    """Game whose own actions are commanded."""
    steps: FromOne = 20_000
    """Number of agent steps for which the hands are commanded; 20,000 are 22 minutes of a robot."""
    hidden: Annotated[int, Ge(1), Le(MAX_HIDDEN)] = 256
    """Number of hidden units."""
    copies: Annotated[int, Ge(1), Le(MAX_COPIES)] = 1
    """Number of models in the file, which learn the same from other first weights. Each game is
    then played by one of them, so that a policy does not learn by the faults of one."""
    seed: Seed = 1
    """Seed of the commands and the first weights; each further copy has the next."""

    def check(self) -> None:
        """Refuses what cannot work. Raises InputError."""
        check_game(self.game)
        check_own_settings(ROBOTS.find(self.robot), self.robot_settings, ROBOT.text)
        check_one_copy(PlayConfig(robot=self.robot))
        if self.output.suffix != ".npz":
            raise InputError(f"{self.output} is no .npz file: name one, such as hands.npz.")
        if self.copies * self.hidden > MAX_UNITS:
            raise InputError(
                f"{self.copies} copies of {self.hidden:,} hidden units are more than a file may "
                f"hold: choose at most {MAX_UNITS // self.copies:,} of them (--hidden)."
            )
        check_new_file(self.output)


def commands(
    choices: Sequence[T], steps: int, rng: Generator, means: Sequence[int] = _HELD
) -> Iterator[T]:
    """Yields the command of each agent step: each is held for a random time, of which ``means`` are
    the means, one after the other."""
    command = choices[0]
    for step in range(steps):
        if rng.random() < 1 / means[step * len(means) // steps]:
            command = choices[int(rng.integers(len(choices)))]
        yield command


def record(
    hands: Hands, told: Iterable[int], tell: Callable[[int], None] = lambda steps: None
) -> Recording:
    """Gives the hands each action of ``told`` for an agent step, and returns what they did.

    Args:
        tell: takes the number of agent steps that are done.
    """
    hands.rest()
    wanted: list[int] = []
    held: list[Keys] = []
    for done, action in enumerate(told, 1):
        held += hold(hands, KEYS_OF_ACTION[action], AGENT_STEP)
        wanted += [action] * AGENT_STEP
        tell(done)
    return Recording(np.array(wanted), np.array([action_of_keys(keys) for keys in held]))


def fit(
    recordings: Sequence[Recording],
    hidden: int,
    seed: int,
    tell: Callable[[int], None] = lambda updates: None,
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
    columns = torch.from_numpy(np.concatenate([inputs(r)[r.known_from :] for r in recordings]))
    held = torch.from_numpy(np.concatenate([r.held[r.known_from :] for r in recordings]))
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
    model = LatencyModel([weights], FRAMES_PER_SECOND)
    alone = record(model, recording.wanted[::AGENT_STEP].tolist())
    return float((alone.held != recording.held).mean())


def _played(options: FitOptions, play: PlayConfig) -> list[Recording]:
    if not options.recordings:
        return []
    with extra_for("--recordings", "record"):
        from actors.robots.latency_model.played import played
    robot = pin(play.robot) if play.latency_model else play.robot
    return [
        game for each in options.recordings for game in played(each, robot, play.robot_settings)
    ]


def run(options: FitOptions) -> None:
    """Measures, learns, tests and writes the model."""
    rng = np.random.default_rng(options.seed)
    play = PlayConfig(robot=options.robot, robot_settings=options.robot_settings)
    actions, tests = MINIMAL_ACTIONS[options.game], max(1, int(options.steps * _TESTED))
    learned = _played(options, play)
    robot = ROBOTS.make(options.robot, SCREEN_SHAPE, CameraConfig(), play)
    with closing(robot), Progress("measuring", options.steps) as progress:
        learned += [record(robot, commands(actions, options.steps, rng), progress.update)]
        tested = record(robot, commands(actions, tests, rng))
    copies = []
    for copy in range(options.copies):
        with Progress(f"learning {copy + 1} of {options.copies}", UPDATES) as progress:
            copies.append(fit(learned, options.hidden, options.seed + copy, progress.update))
    write_copies(options.output, copies)
    changes = int((np.diff(tested.held) != 0).sum())
    shares = [differing(each, tested) for each in copies]
    print(
        f"wrote {options.output}: in {counted(len(tested.held), 'other frame')} with "
        f"{counted(changes, 'change')} of keys, it holds other keys than {options.robot} in "
        f"{', '.join(f'{100 * share:.2f} %' for share in shares)}.\n"
        + (_FEW if changes < _MANY or max(shares) > _GOOD else "")
        + f"play by it: --robot {options.output} --play.robot-settings rate={FRAMES_PER_SECOND}"
    )


def main() -> None:
    options = parse(FitOptions, "actors.robots.latency_model.fit", sys.argv[1:])
    options.check()
    run(options)


if __name__ == "__main__":
    exit_on_input_error(main)

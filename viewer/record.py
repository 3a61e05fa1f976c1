"""`python -m viewer record`: records the games of one network as a dataset."""

import threading
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from actors.envs import make_env
from actors.loop import play, seeds_of
from actors.policy import Policy
from common.checked import Amount, Count, Fraction
from common.command_line.parser import WeightsFile
from common.command_line.played import Played
from common.errors import InputError
from common.minus import points
from common.process.extras import check_extra
from common.process.progress import Progress
from common.settings.clock import ClockConfig
from viewer.recorder import Recorder, check_new_folder


@dataclass(frozen=True, kw_only=True)
class Record(Played):
    """Record a network's games as a LeRobot dataset: camera, keys, joints and rewards.

    `ale-robot train --demonstrations FOLDER` starts a run with them. Each game is added when it
    ends, so an interrupted recording has all earlier games.
    """

    weights: tyro.conf.Positional[WeightsFile]
    """Network that plays, such as robot_pong or runs/NAME/snapshots/best.safetensors."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder of the recording, which must not exist yet."""
    games: Count = 0
    """Number of whole games; 1 by default."""
    minutes: Amount = 0.0
    """Minutes of game time, instead of whole games, which 0 records; the last game is cut short."""
    epsilon: Fraction = 0.001
    """Share of random actions."""
    clock: tyro.conf.OmitArgPrefixes[ClockConfig] = field(default_factory=ClockConfig)

    @property
    def network(self) -> Path:
        return self.weights

    def check(self) -> None:
        check_extra("a recording", "record")
        check_new_folder(self.output)
        if self.games and self.minutes:
            raise InputError("--games and --minutes exclude each other: omit one of them.")
        self.clock.check(self.config().env)

    def run(self, stop: threading.Event) -> None:
        """Records the games or the minutes, or until ``stop`` is set. Raises InputError if weights
        or folder cannot be used."""
        config = self.config()
        self.tell_changes()
        policy_seed, env_seed = seeds_of(config.seed)
        policy = Policy.of_file(config, self.weights, self.epsilon, policy_seed)
        # Episodes end at a lost life, as those of a run's actors do.
        env = make_env(config, self.clock, training=True)
        total = self.minutes * 60 * env.rate or self.games or 1
        with (
            closing(env),
            closing(Recorder(env, config, self.output)) as recorder,
            Progress("recording", total) as progress,
        ):
            done = 0.0
            for step in play([recorder], policy, [env_seed]):
                recorder.add(step)
                advanced = step.info.elapsed if self.minutes else step.info.game_over
                done += advanced
                # Whole games move the bar after minutes.
                progress.update(done, note=f"{recorder.steps:,} steps")
                if step.info.game_over:
                    score, games = step.info.game_score, recorder.dataset.episodes
                    print(f"game {games}: score {points(score)}", flush=True)
                if done >= total or stop.is_set():
                    break
        print(recorder.summary)

"""`python -m viewer play`: plays games for show, and films or streams them."""

import threading
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from actors.envs.shown_env import ShownEnv
from actors.loop import play, seeds_of
from common.checked import Amount, Fraction, FromOne
from common.command_line.played import Played
from common.counted import counted
from common.errors import InputError
from common.minus import minus_signed, points
from common.process.extras import check_extra
from common.process.progress import Progress
from common.settings.clock import ClockConfig
from viewer.movie import check_movie, open_movie
from viewer.panels import Panels
from viewer.player import File, Network, ShownPolicy, shown_env, unfinished
from viewer.rerun_stream import RerunStream
from viewer.terminal.rendering import ROOM_EVERY


@dataclass(frozen=True)
class Play(Played):
    """Play games, with random actions or a network, and print each game's score.

    A network plays under the settings of its run, except for those given here.
    """

    weights: Network = None
    """Network that plays, such as robot_pong or runs/NAME/snapshots/best.safetensors."""
    epsilon: Fraction = 0.001
    """Share of random actions in the network's play; evaluations of 2017 had 0.05."""
    games: FromOne | None = None
    """Number of whole games; 1 unless --seconds is given."""
    seconds: Amount = 0.0
    """Seconds of play instead, in as many games as that takes."""
    video: File = None
    """Film of the panels; its name ends in .mp4, or in .gif with --seconds. An existing film is
    replaced once the new one is whole."""
    viewer: Literal["rerun"] | None = None
    """Live viewer of room, pictures and figures: a window, or a page if there is no display. It
    needs pip install 'ale-robot[viz]'."""
    save: File = None
    """Recording for Rerun's viewer; its name ends in .rrd."""
    nao_urdf: File = None
    """URDF of another NAO, with meshes, to show in the panels; the physics stay the same."""
    clock: tyro.conf.OmitArgPrefixes[ClockConfig] = field(default_factory=ClockConfig)

    @property
    def network(self) -> Path | None:
        return self.weights

    def check(self) -> None:
        if self.games and self.seconds:
            raise InputError("--games and --seconds are two lengths: choose one.")
        if self.viewer is not None or self.save is not None:
            check_extra("--viewer rerun or --save", "viz")
        if self.video is not None:
            check_movie(self.video, self.seconds)
        if self.nao_urdf is not None and self.video is None:
            raise InputError("--nao-urdf shows another NAO in a film: add --video FILE.")
        self.clock.check(self.config().env)

    def run(self, stop: threading.Event) -> None:
        """Plays the games or the seconds, or until ``stop`` is set. Raises InputError if weights,
        viewer or the NAO of --nao-urdf cannot be used."""
        config = self.config()
        self.tell_changes()
        policy_seed, env_seed = seeds_of(config.seed)
        policy = ShownPolicy.of_file(config, self.weights, self.epsilon, policy_seed)
        with (
            shown_env(config, self.clock) as env,
            nullcontext() if self.video is None else open_movie(self.video, env.rate) as film,
            closing(Panels(env, self.nao_urdf, room_every=ROOM_EVERY)) as panels,
            Progress("filming" if self.video else "playing", self.seconds or None) as progress,
            self._stream(env) as stream,
        ):
            scores: list[float] = []
            missed = 0
            played = 0
            for step in play([env], policy, [env_seed]):
                if film is not None:
                    picture = panels.draw(step, policy.values)
                    # A step of several agent steps is shown for longer.
                    for _ in range(step.info.elapsed):
                        film(picture)
                if stream is not None:
                    stream.show(step, policy.values)
                missed += step.info.missed_deadlines
                if step.info.game_over:
                    scores.append(step.info.game_score)
                    # In real time the world does not wait while pictures are taken.
                    late = "" if self.clock.sync else f", {missed} deadlines missed"
                    print(
                        f"game {len(scores)}: score {points(scores[-1])} "
                        f"in {counted(step.info.game_steps, 'step')}{late}",
                        flush=True,
                    )
                    missed = 0
                played += step.info.elapsed
                seconds = played / env.rate
                progress.update(seconds, note=f"{seconds:.0f} s of play")
                ended = (
                    seconds >= self.seconds if self.seconds else len(scores) == (self.games or 1)
                )
                if ended or stop.is_set():
                    if not scores:
                        print(unfinished(step.info))
                    if not ended:
                        print(f"stopped after {seconds:.1f} s of play")
                    break
            if len(scores) > 1:
                mean = minus_signed(f"{np.mean(scores):.2f}")
                print(f"mean score of {len(scores)} games: {mean}")
            if stream is not None:
                stream.linger(stop)
        for file in (self.video, self.save):
            if file is not None:
                print(f"wrote {file}")

    def _stream(self, env: ShownEnv[Any, Any]) -> AbstractContextManager[RerunStream | None]:
        if self.viewer is None and self.save is None:
            return nullcontext()
        return closing(RerunStream(env, live=self.viewer is not None, save=self.save))

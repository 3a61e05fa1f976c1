"""`python -m viewer film`: a film of one network's play, or of how a run learned."""

import threading
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass, fields
from itertools import islice
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray

from actors.loop import play, seeds_of
from common.checked import Amount, Fraction
from common.command_line.played import Played
from common.errors import InputError
from common.process.progress import Progress
from common.run.epochs import EpochRow, EpochTable
from common.run.folder import RunFolder, kept_networks
from common.run.newest_learner import NewestLearner
from common.run.origin import find_weights, run_meant_by, shown_weights
from viewer import overlay
from viewer.movie import check_movie, open_movie
from viewer.panels import Panels
from viewer.player import File, ShownPolicy, shown_env
from viewer.show import Play

_CHAPTER = 8.0
"""Seconds of a chapter's play: a few rallies."""
_TITLE = 36
"""Height of the line above the panels."""
_TIME = 3
"""Height of the bar at its foot, pixels."""


class Chapter(NamedTuple):
    """The play of one epoch's network; None for random play."""

    title: str
    weights: Path | None


@dataclass(frozen=True)
class Film(Played):
    """Film a game; or, with a run, how it learned.

    The film of a run shows random play, or the network with which the run began, and then each
    epoch's network for a few seconds. The run must keep its snapshots (--keep-snapshots).
    """

    shown: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[FILE]")] = None
    """Run that is filmed epoch by epoch, or its folder; or a network, such as
    robot_pong or runs/NAME/snapshots/best.safetensors; by default the published one of --env and
    --game, or random actions if there is none."""
    epsilon: Fraction = 0.001
    """Share of random actions of the network's play."""
    seconds: Amount = 0.0
    """Seconds of play, in as many games as that takes, for each epoch of a run (8 by default); 0
    films a whole game."""
    video: File = None
    """Film; its name ends in .mp4 or .gif. An existing film is replaced once the new one is whole.
    By default film.mp4, or films/learning.mp4 in the folder of a run that is filmed epoch by
    epoch."""
    nao_urdf: File = None
    """URDF of another NAO, with meshes, to show in the panels; the physics stay the same."""

    @property
    def network(self) -> Path | None:
        """The network to film; of a run, its newest, because all have the same settings. None for
        random actions."""
        if (run := self._run) is not None:
            newest = chapters_of(run)[-1].weights
            assert newest is not None
            return newest
        if self.shown:
            return find_weights(self.shown)
        return shown_weights(self.env, self.game, self.play.robot)

    def check(self) -> None:
        if (run := self._run) is None:
            self._play().check()
            return
        self.config()
        check_movie(self._video_of(run), self.seconds or _CHAPTER, len(chapters_of(run)))

    def run(self, stop: threading.Event) -> None:
        """Films until the end, or until ``stop``. Raises InputError if the film cannot be
        written."""
        if (run := self._run) is None:
            if self.network is None:
                print("no published policy plays this: actions are random")
            self._play().run(stop)
        else:
            self._time_lapse(run, stop)

    @property
    def _run(self) -> Path | None:
        """The folder of the run to film; None if it is one network."""
        if self.shown is None:
            return None
        if (run := run_meant_by(self.shown)) is not None:
            return run.path
        return self.shown if self.shown.is_dir() else None

    def _play(self) -> Play:
        return Play(
            **{field.name: getattr(self, field.name) for field in fields(Played)},
            weights=self.network,
            epsilon=self.epsilon,
            seconds=self.seconds,
            video=self.video or Path("film.mp4"),
            nao_urdf=self.nao_urdf,
        )

    def _video_of(self, run: Path) -> Path:
        return self.video or run / "films" / "learning.mp4"

    def _time_lapse(self, folder: Path, stop: threading.Event) -> None:
        chapters = chapters_of(folder)
        video = self._video_of(folder)
        config = self.config()
        policy_seed, env_seed = seeds_of(config.seed)
        self.tell_changes()
        with (
            shown_env(config) as env,
            closing(Panels(env, self.nao_urdf, orbiting=True)) as panels,
            open_movie(video, env.rate) as film,
            Progress("filming", len(chapters)) as progress,
        ):
            steps = max(round((self.seconds or _CHAPTER) * env.rate), 1)
            played = (
                (title, step, policy.values)
                for title, weights in chapters
                for policy in [ShownPolicy.of_file(config, weights, self.epsilon, policy_seed)]
                for step in islice(play([env], policy, [env_seed]), steps)
            )
            for done, (title, step, values) in enumerate(played, start=1):
                passed = done / steps
                film(titled(panels.draw(step, values), title, passed / len(chapters)))
                progress.update(passed, note=title)
                if stop.is_set():
                    print(f"stopped after {done / env.rate:.1f} s of play")
                    break
        print(f"wrote {video}")


def chapters_of(folder: Path) -> list[Chapter]:
    """Returns what a run began with and its kept snapshots, the oldest first. Raises InputError if
    it is not a run's folder, or the run has kept none."""
    run = RunFolder.existing(folder)
    learner = NewestLearner.of(run)
    # Of a run that keeps none, those are there that wait for their tests.
    keeps = learner is None or learner.keeps_snapshots
    networks = kept_networks(run.snapshots) if keeps else {}
    if not networks:
        newest = f", or film one network: {run.checkpoint}" if run.checkpoint.is_file() else ""
        raise InputError(f"{folder} has kept no snapshots: train with --keep-snapshots{newest}.")
    rows = EpochTable(run.epochs).rows()
    titles = [_title(epoch, rows) for epoch in networks]
    begun = Chapter("random play", None)
    if run.initial.exists():
        begun = Chapter("the network that the run began with", run.initial)
    return [begun, *map(Chapter, titles, networks.values())]


def _title(epoch: int, rows: Iterable[EpochRow]) -> str:
    found: dict[str, EpochRow] = {row.phase: row for row in rows if row.epoch == epoch}
    parts = [f"epoch {epoch}"]
    if trained := found.get("train"):
        hours, rest = divmod(round(trained.total_time), 3600)
        parts += [f"{trained.total_train_steps:,} steps", f"{hours}:{rest // 60:02} h"]
    for phase, score in (("test", "test score"), ("train", "score in training")):
        if (row := found.get(phase)) and row.average_reward is not None:
            parts.append(f"{score} {row.average_reward:.1f}")
            break
    return "   ".join(parts)


def titled(picture: NDArray[np.uint8], title: str, share: float) -> NDArray[np.uint8]:
    """Returns ``picture`` below a line with ``title``, and a bar as long as that ``share`` of the
    film which is over."""
    line = np.full((_TITLE, picture.shape[1], 3), overlay.PAPER, np.uint8)
    overlay.write(line, title, (12, 24), size=0.7)
    line[-_TIME:, : round(share * line.shape[1])] = overlay.YELLOW
    return np.vstack((line, picture))

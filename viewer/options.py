"""The flags of `python -m actors` that look instead of joining a run."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from common.errors import InputError

LONGEST_GIF = 120
"""s of play; 350 MB of memory."""

Switch = Annotated[bool, tyro.conf.FlagCreatePairsOff]


@dataclass(frozen=True)
class LookingOptions:
    """Look instead of joining a run: --check, --play or --human. These need no hub; --env (robot
    unless said otherwise), --game (pong) and --seed say what is played."""

    check: Switch = False
    """Does the robot see and touch? Prints gates and latencies, writes a picture of four panels;
    exit code 1 when a gate is red."""
    play: Switch = False
    """Play, at random or with --weights, and print each game's score."""
    human: Switch = False
    """Play yourself through the robot's hands: arrow keys and space, in this terminal."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FILE.png")] = Path("check.png")
    """Of --check: the picture."""
    weights: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Of --play: a network to play with, such as runs/NAME/snapshots/best.safetensors; that run's
    settings are used."""
    video: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Of --play: record the panels; the name ends in .mp4, or in .gif with --seconds."""
    viewer: Literal["rerun"] | None = None
    """Of --play, which it implies: stream the panels live to Rerun (pip install
    'ale-robot[viz]')."""
    games: int = 1
    """Of --play: how many games, each to its end."""
    seconds: float = 0.0
    """Of --play: end after so many seconds of play, for a short film; 0 plays whole games."""
    epsilon: float = 0.001
    """Of --play with weights: share of random actions; the report's tests have 0.05."""
    minimal_actions: Switch = False
    """The game's own actions only (Pong: 6) instead of all 18; --weights of a run go with that
    run's."""
    nao_urdf: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Of --check and --play: show a NAO of your own, with meshes, in the pictures of the room;
    the physics stay ours."""

    @property
    def plays(self) -> bool:
        """A robot is to play for show."""
        return self.play or self.viewer is not None

    @property
    def looks(self) -> bool:
        """Anything here is asked for, so that no hub is needed."""
        return self.check or self.plays or self.human

    def check_flags(self) -> None:
        """Refuse flags that do not go together.

        Raises:
            InputError: naming them.
        """
        modes = [
            flag
            for flag, given in (
                ("--check", self.check),
                ("--play" if self.play else "--viewer", self.plays),
                ("--human", self.human),
            )
            if given
        ]
        if len(modes) > 1:
            raise InputError(f"{' and '.join(modes)} exclude each other: choose one.")
        for flag, given, owner, wanted in (
            ("--weights", self.weights is not None, "--play", self.plays),
            ("--video", self.video is not None, "--play", self.plays),
            ("--seconds", self.seconds > 0, "--play", self.plays),
            (
                "--nao-urdf",
                self.nao_urdf is not None,
                "--check or --play",
                self.check or self.plays,
            ),
            ("--minimal-actions", self.minimal_actions, "--check, --play or --human", self.looks),
        ):
            if given and not wanted:
                raise InputError(f"{flag} belongs to {owner}: add it, or leave {flag} away.")
        if not 0.0 <= self.epsilon <= 1.0:
            raise InputError(f"--epsilon is {self.epsilon}: choose a number from 0 to 1.")
        if self.games < 1:
            raise InputError(f"--games is {self.games}: choose 1 or more.")
        gif = self.video is not None and self.video.suffix == ".gif"
        if gif and not 0 < self.seconds <= LONGEST_GIF:
            raise InputError(
                f"a GIF is all in memory until its end: choose --seconds up to {LONGEST_GIF}, "
                "or an .mp4."
            )
        if not 0.0 <= self.seconds < float("inf"):
            raise InputError(f"--seconds is {self.seconds}: choose a number that is not negative.")

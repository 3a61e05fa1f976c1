"""The flags of `python -m actors` that check or show a robot instead of joining a run."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from common.errors import InputError

LONGEST_GIF = 120
"""Seconds of play; 350 MB of memory."""

Switch = Annotated[bool, tyro.conf.FlagCreatePairsOff]


@dataclass(frozen=True)
class ViewerOptions:
    """Check or show a robot instead of joining a run: --check, --play or --human. These need no
    hub; --env (default robot), --game (pong) and --seed say what is played."""

    check: Switch = False
    """Health checks of sight and touch: prints them with the hands' latencies and writes a picture
    of four panels; exit code 1 when one is red."""
    play: Switch = False
    """Play, at random or with --weights, and print each game's score."""
    human: Switch = False
    """Play yourself through the robot's hands: arrow keys and space, in this terminal."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FILE.png")] = Path("check.png")
    """File of the picture, of --check."""
    weights: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Network that plays, of --play, such as runs/NAME/snapshots/best.safetensors; that run's
    settings are used."""
    video: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Film of the panels, of --play; its name ends in .mp4, or in .gif with --seconds."""
    viewer: Literal["rerun"] | None = None
    """Live viewer of the panels, of --play, which it implies; Rerun needs pip install
    'ale-robot[viz]'."""
    games: int = 1
    """Number of whole games, of --play."""
    seconds: float = 0.0
    """Seconds of play, of --play, for a short film; 0 plays whole games."""
    epsilon: float = 0.001
    """Share of random actions, of --play with --weights; evaluations had 0.05 in 2017."""
    minimal_actions: Switch = False
    """Actions of the game only (Pong: 6) instead of all 18; with --weights, those of their
    run."""
    nao_urdf: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """URDF of another NAO, with meshes, to show in the pictures of --check and --play; the physics
    stay the same."""

    @property
    def plays(self) -> bool:
        """Whether the robot plays games to be watched."""
        return self.play or self.viewer is not None

    @property
    def used(self) -> bool:
        """Whether any of the modes is asked for, so that no hub is needed."""
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
            ("--minimal-actions", self.minimal_actions, "--check, --play or --human", self.used),
        ):
            if given and not wanted:
                raise InputError(f"{flag} belongs to {owner}: add it, or omit {flag}.")
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

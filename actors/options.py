"""The command line of `python -m actors`: its flags, and what they mean together."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from annotated_types import Ge, Le

from common.checked import Patience
from common.endpoint import DEFAULT_ENDPOINT
from common.errors import InputError
from common.native.kernel import KernelChoice, PrecisionChoice
from common.pinned_file import path_of
from common.settings.clock import ClockConfig
from common.settings.config import MAX_ENVS, RunConfig, Seed


@dataclass(frozen=True)
class ActorOptions:
    """Join a run: play, send steps to its replay, and follow its learner's weights.

    The run's hub tells what to play and how, so a plain `python -m actors --sync` is enough. Start
    one process for each core, on any number of machines. To check, show or play one robot without
    a run, use `python -m viewer`.
    """

    ELSEWHERE: ClassVar = {
        **{
            f"--{command}": f"is a command of its own: call `ale-robot {command}`"
            for command in ("check", "play", "human")
        },
        "--viewer": "is for `ale-robot play`: call that",
        "--weights": "is for `ale-robot play`, which takes a network without a flag: call that",
    }

    clock: tyro.conf.OmitArgPrefixes[ClockConfig] = field(default_factory=ClockConfig)
    connect: str = DEFAULT_ENDPOINT
    """Address of the run's hub: the learner, or a separate replay."""
    certificates: Path | None = None
    """Folder of certificates, if the hub's address begins with tls/; see deploy/README.md."""
    run: str | None = None
    """Name of the run; needed only if a hub serves several."""
    env: str | None = None
    """Environment that the run must play in; no other run is joined."""
    game: str | None = None
    """Game that the run must play; no other run is joined."""
    robot: str | None = None
    """Robot that the run must have; no other run is joined."""
    envs: Annotated[int, Ge(1), Le(MAX_ENVS)] = 1
    """Number of environments in this process, played with one forward pass."""
    precision: PrecisionChoice = "auto"
    """Precision of the native kernel; 'auto' takes bfloat16 if the processor multiplies it faster.
    Where the kernel is not the faster one in bfloat16, float32 is taken. PyTorch computes in
    float32."""
    kernel: KernelChoice = "auto"
    """Code of the network: 'torch', or 'native', which g++ or clang compiles here once; 'auto'
    takes what is faster. Evaluators compute by 'torch'."""
    evaluator: bool = False
    """Role of an evaluator: play the learner's evaluation jobs instead of training."""
    name: str | None = None
    """Name of this actor in displays and statistics; by default the name in its certificate, or one
    made from the host's name."""
    seed: Seed | None = None
    """Seed of this actor's games; by default a new one at every start, so that a restarted actor
    does not repeat its games."""
    patience: Patience = 300.0
    """Seconds to wait for the hub, at the start and whenever it goes away."""
    log_json: bool = False
    """Output as lines of JSON instead of plain lines."""

    def check(self) -> None:
        self.clock.check(envs=self.envs)
        if self.evaluator and self.envs != 1:
            raise InputError("an evaluator plays one game at a time: omit --envs.")
        if self.evaluator and self.kernel == "native":
            raise InputError("an evaluator computes by PyTorch: omit --kernel native.")
        if self.evaluator and self.precision != "auto":
            raise InputError(
                f"an evaluator computes in float32: omit --precision {self.precision}."
            )

    def check_against(self, config: RunConfig) -> None:
        """Refuses a run that plays something other than these options ask for."""
        for flag, wanted, found in (
            ("--env", self.env, config.env),
            ("--game", self.game, config.task),
            ("--robot", self.robot and str(path_of(self.robot)), config.hands),
        ):
            if wanted is not None and wanted != found:
                plays = found or f"{config.played}, without a robot"
                raise InputError(f"the run plays {plays}, not {wanted}: omit {flag} to join it.")
        self.clock.check(config.env)

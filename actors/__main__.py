"""`python -m actors`: robots, or emulators alone, that join a run and play for it."""

if __name__ == "__main__":
    import os
    import sys

    # A working directory that does not hold this package may hold another `common`.
    if not sys.flags.safe_path and sys.path[0] != os.path.dirname(os.path.dirname(__file__)):
        del sys.path[0]
        os.environ["PYTHONSAFEPATH"] = "1"  # for the programs that this one starts

    from common.process.lifeline import leave_at_interrupt, leave_on_leash

    leave_at_interrupt()
    leave_on_leash()

import os
import secrets
import socket
import sys
import threading
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import torch
import tyro
from annotated_types import Ge, Le, Lt

from actors.actor import Actor
from actors.envs import make_env
from actors.evaluator import Evaluator
from actors.member import Member
from actors.policy import Policy
from common.checked import Patience
from common.errors import InputError, exit_on_input_error
from common.network import build_network
from common.pinned_file import path_of
from common.process.allocator import keep_large_blocks
from common.process.command_line import parse
from common.process.lifeline import on_signals
from common.process.log_lines import say_json
from common.process.service_manager import tell
from common.process.threads import end_with_any_thread
from common.protocol.run_keys import DEMONSTRATIONS, check_name
from common.run.clock import ClockConfig
from common.run.config import MAX_SEED, RunConfig
from common.run.join import find_run, patiently
from common.transport.credentials import check_certificates, own_name
from common.transport.endpoint import DEFAULT_ENDPOINT
from common.transport.signature import checker
from common.transport.zenoh_transport import connect

_VIEWER_COMMANDS = {"--check": "check", "--play": "play", "--human": "human", "--viewer": "play"}
"""Flags that a former version had here, and the commands of `python -m viewer` that they mean."""


@dataclass(frozen=True)
class ActorOptions:
    """Join a run: play, send what happened to its replay, and follow its learner's weights.

    What is played and how comes from the run's hub, so a plain `python -m actors --sync` is
    enough. Start as many as there are cores, on as many machines as there are. To check, show or
    play one robot without any run, use `python -m viewer`.
    """

    clock: tyro.conf.OmitArgPrefixes[ClockConfig] = field(default_factory=ClockConfig)
    connect: str = DEFAULT_ENDPOINT
    """Address of the run's hub (the learner, or a replay of its own)."""
    certificates: Path | None = None
    """Folder of certificates, where the hub's address begins with tls/; see deploy/README.md."""
    run: str | None = None
    """Name of the run; needed only where a hub serves several."""
    env: str | None = None
    """Environment that the run must play in, or it is not joined."""
    game: str | None = None
    """Game that the run must play, or it is not joined."""
    robot: str | None = None
    """Robot that the run must have, or it is not joined."""
    envs: Annotated[int, Ge(1), Le(256)] = 1
    """Number of environments in this process, played with one forward pass."""
    evaluator: bool = False
    """Role: play the learner's evaluation jobs instead of training."""
    name: str | None = None
    """Name of this actor in displays and statistics; by default that in its certificate, or one
    made of the host's name."""
    seed: Annotated[int, Ge(0), Lt(MAX_SEED)] | None = None
    """Seed of this actor's games; by default another one at every start, so that a restarted actor
    does not repeat its games."""
    patience: Patience = 300.0
    """Seconds to wait for the hub, at the start and whenever it goes away."""
    log_json: bool = False
    """Lines of JSON instead of a screen or lines for people."""

    def check(self) -> None:
        self.clock.check()
        if self.evaluator and self.envs != 1:
            raise InputError("an evaluator plays one game at a time: omit --envs.")

    def check_against(self, config: RunConfig) -> None:
        """Refuse a run that plays something else than asked for."""
        for flag, wanted, found in (
            ("--env", self.env, config.env),
            ("--game", self.game, config.game),
            ("--robot", self.robot, str(path_of(config.play.robot))),
        ):
            if wanted is not None and wanted != found:
                raise InputError(f"the run plays {found}, not {wanted}: omit {flag} to join it.")
        self.clock.check(config.env)


def default_name() -> str:
    """The host's name and six random digits."""
    host = "".join(c if c.isalnum() else "-" for c in socket.gethostname().split(".")[0])
    return f"{host.strip('-')[:40] or 'actor'}-{secrets.token_hex(3)}"


def viewer_command(arguments: Sequence[str]) -> list[str]:
    """Returns the arguments of `python -m viewer` that ``arguments`` mean; none if they join a
    run."""
    given = {argument.partition("=")[0] for argument in arguments}
    for flag, command in _VIEWER_COMMANDS.items():
        if flag in given:
            # Only play has a clock; lockstep is what the others go by anyway.
            understood = {f"--{command}", "--sync"}
            return [command, *(each for each in arguments if each not in understood)]
    return []


def main() -> int:
    if command := viewer_command(sys.argv[1:]):
        os.execv(sys.executable, [sys.executable, "-m", "viewer", *command])
    options = parse(ActorOptions, "actors", sys.argv[1:])
    options.check()
    if options.log_json:
        say_json("evaluator" if options.evaluator else "actor")
    name = options.name
    if name is None and options.certificates is not None:
        name = own_name(options.certificates)
    name = check_name("actor", name or default_name())
    if name == DEMONSTRATIONS:
        raise InputError(f"{name!r} stands for recorded games: choose another --name.")
    stop = threading.Event()
    on_signals(stop)
    keep_large_blocks()
    # One core each: parallelism is between processes, and threads would fight over cores.
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    stopped = patiently(stop, options.connect)
    with (
        end_with_any_thread(stop),
        connect(
            *(options.connect, options.patience, stopped),
            name=name,
            certificates=options.certificates,
        ) as transport,
    ):
        keys, config = find_run(
            transport, options.run, options.patience, stopped, options.certificates
        )
        options.check_against(config)
        trusted = check_certificates(options.connect, options.certificates, "actor", name)
        check = checker(trusted)
        member = Member(
            *(name, transport, keys, config, options.patience, stop), check_weights=check
        )
        entropy = (
            [config.seed, zlib.crc32(name.encode()), member.incarnation]
            if options.seed is None
            else [options.seed]
        )
        policy_seed, *seeds = np.random.SeedSequence(entropy).generate_state(1 + options.envs)
        envs = [
            make_env(config, options.clock, training=not options.evaluator)
            for _ in range(options.envs)
        ]
        actions = int(envs[0].action_space.n)  # type: ignore[attr-defined]
        if actions != config.action_count:
            raise InputError(
                f"{config.game} ({config.env}) offers {actions} actions here, but the run has "
                f"{config.action_count}: install the versions of requirements.lock."
            )
        policy = Policy(
            build_network(config, actions),
            actions,
            np.random.default_rng(policy_seed),
            envs=options.envs,
            # An evaluation explores as in 2017: random actions are drawn anew at every step.
            exploration=None if options.evaluator else config.exploration,
        )
        tell("READY=1", f"STATUS=plays for run {keys.run} at {options.connect}")
        member.warn(
            f"plays {config.game} ({config.env}{options.clock}) for run {keys.run} at "
            f"{options.connect}."
        )
        try:
            if options.evaluator:
                Evaluator(member, envs[0], policy).run(int(seeds[0]))
            else:
                Actor(member, envs, policy).run([int(seed) for seed in seeds])
        finally:
            for env in envs:
                env.close()
    return 0


if __name__ == "__main__":
    exit_on_input_error(main)

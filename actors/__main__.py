"""`python -m actors`: robots, or emulators alone, that join a run and play for it."""

import secrets
import socket
import sys
import threading
import time
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import torch
import tyro

from actors.actor import Actor
from actors.envs import make_env
from actors.evaluator import Evaluator
from actors.policy import Policy
from actors.viewer_options import ViewerOptions
from common.errors import InputError, exit_on_input_error
from common.network import build_network
from common.process.allocator import keep_large_blocks
from common.process.command_line import parse
from common.process.lifeline import leave_with_parent, on_signals
from common.process.threads import end_with_any_thread
from common.protocol.run_keys import check_name
from common.run.clock import ClockConfig
from common.run.config import MAX_SEED, RunConfig
from common.run.join import find_run
from common.transport.endpoint import DEFAULT_ENDPOINT
from common.transport.zenoh_transport import connect


@dataclass(frozen=True)
class ActorOptions:
    """Join a run: play, send what happened to its replay, and follow its learner's weights.

    What is played and how comes from the run's hub, so a plain `python -m actors --sync` is
    enough. Start as many as there are cores, on as many machines as there are. Or check, play or
    show one robot without any run: see the viewer options.
    """

    clock: tyro.conf.OmitArgPrefixes[ClockConfig] = field(default_factory=ClockConfig)
    connect: str = DEFAULT_ENDPOINT
    """Address of the run's hub (the learner, or a replay of its own)."""
    certificates: Path | None = None
    """Folder of certificates, where the hub's address begins with tls/; see deploy/README.md."""
    run: str | None = None
    """Name of the run; needed only where a hub serves several."""
    env: str | None = None
    """Join only if the run plays in this environment."""
    game: str | None = None
    """Join only if the run plays this game."""
    envs: int = 1
    """Environments in this process, played with one forward pass."""
    evaluator: bool = False
    """Play the learner's evaluation jobs instead of training."""
    name: str | None = None
    """Name of this actor in displays and statistics; by default made of the host's name."""
    seed: int | None = None
    """Seed of this actor's games; by default another one at every start, so that a restarted actor
    does not repeat its games."""
    patience: float = 300.0
    """Seconds to wait for the hub, at the start and whenever it goes away."""
    leash: bool = False
    """Leave when standard input ends; the learner's local mode holds the other end."""
    viewing: tyro.conf.OmitArgPrefixes[ViewerOptions] = field(default_factory=ViewerOptions)

    def check(self) -> None:
        self.viewing.check_flags()
        self.clock.check()
        if self.seed is not None and not 0 <= self.seed < MAX_SEED:
            raise InputError(f"--seed is {self.seed}: choose a number from 0 to {MAX_SEED - 1}.")
        if not 1 <= self.envs <= 256:
            raise InputError(f"--envs is {self.envs}: choose a number from 1 to 256.")
        if self.evaluator and self.envs != 1:
            raise InputError("an evaluator plays one game at a time: omit --envs.")

    def check_against(self, config: RunConfig) -> None:
        """Refuse a run that plays something else than asked for."""
        for flag, wanted, found in (
            ("--env", self.env, config.env),
            ("--game", self.game, config.game),
        ):
            if wanted is not None and wanted != found:
                raise InputError(f"the run plays {found}, not {wanted}: omit {flag} to join it.")
        self.clock.check(config.env)


def default_name() -> str:
    """The host's name and six random digits."""
    host = "".join(c if c.isalnum() else "-" for c in socket.gethostname().split(".")[0])
    return f"{host.strip('-')[:40] or 'actor'}-{secrets.token_hex(3)}"


def view(options: ActorOptions) -> int:
    """Check or show a robot, or let a person play, without any run; returns the exit status."""
    # Late, because an actor that trains needs none of it.
    from viewer.check import check
    from viewer.human import play_by_hand
    from viewer.player import config_to_play
    from viewer.show import show

    viewing = options.viewing
    stop = threading.Event()
    on_signals(stop)
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    config = config_to_play(viewing.weights, options.env, options.game, viewing.minimal_actions)
    options.clock.check(config.env)
    seed = config.seed if options.seed is None else options.seed
    if viewing.check:
        return check(config, viewing.output, nao_urdf=viewing.nao_urdf, seed=seed, stop=stop)
    if viewing.human:
        return play_by_hand(config, seed=seed, stop=stop)
    return show(viewing, config, options.clock, seed=seed, stop=stop)


def main() -> int:
    options = parse(ActorOptions, "actors", sys.argv[1:])
    options.check()
    if options.viewing.used:
        return view(options)
    name = check_name("actor", options.name or default_name())
    stop = threading.Event()
    on_signals(stop)
    if options.leash:
        leave_with_parent(stop)
    keep_large_blocks()
    # One core each: parallelism is between processes, and threads would fight over cores.
    torch.set_num_threads(1)
    cv2.setNumThreads(1)

    def warn(text: str) -> None:
        print(f"{name}: {text}", file=sys.stderr, flush=True)

    with (
        end_with_any_thread(stop),
        connect(
            options.connect, options.patience, stop.is_set, certificates=options.certificates
        ) as transport,
    ):
        keys, config = find_run(transport, options.run, options.patience, stop.is_set)
        options.check_against(config)
        incarnation = time.time_ns()
        entropy = (
            [config.seed, zlib.crc32(name.encode()), incarnation]
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
        warn(
            f"plays {config.game} ({config.env}{options.clock}) for run {keys.run} at "
            f"{options.connect}."
        )
        try:
            if options.evaluator:
                Evaluator(
                    transport,
                    keys,
                    name,
                    incarnation,
                    envs[0],
                    policy,
                    patience=options.patience,
                    stop=stop,
                    warn=warn,
                ).run(int(seeds[0]))
            else:
                Actor(
                    transport,
                    config,
                    keys,
                    name,
                    incarnation,
                    envs,
                    policy,
                    patience=options.patience,
                    stop=stop,
                    warn=warn,
                ).run([int(seed) for seed in seeds])
        finally:
            for env in envs:
                env.close()
    return 0


if __name__ == "__main__":
    exit_on_input_error(main)

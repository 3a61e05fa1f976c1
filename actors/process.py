"""The process that plays for a run, from its options until it leaves."""

import secrets
import socket
import threading
import zlib
from contextlib import ExitStack, closing
from dataclasses import replace

import cv2
import numpy as np
import torch

from actors.actor import Actor
from actors.envs import make_env
from actors.evaluator import Evaluator
from actors.member import Member
from actors.options import ActorOptions
from actors.policy import Policy
from common.errors import InputError
from common.native.kernel import bfloat16_is_faster, choose_kernel
from common.native.library import InstructionSet
from common.native.network import NativeQNetwork
from common.network import QNetwork, build_network
from common.process.allocator import keep_large_blocks
from common.process.lifeline import on_signals
from common.process.service_manager import tell
from common.process.threads import end_with_any_thread
from common.protocol.run_keys import DEMONSTRATIONS, check_name
from common.run.join import find_run, patiently
from common.settings.config import RunConfig
from common.transport.chosen import connect
from common.transport.credentials import check_certificates, own_name
from common.transport.signature import checker


def join(options: ActorOptions) -> None:
    """Joins a run and plays for it until it is over, or a signal comes.

    Raises:
        InputError: the run cannot be joined, or its hub went away for longer than the patience.
    """
    name = _name_of(options)
    # Now, for it may have to be compiled, before anybody waits for this actor.
    if not _instruction_set(options):
        options = replace(options, kernel="torch")
    stop = threading.Event()
    on_signals(stop)
    keep_large_blocks()
    # Each process uses one core: several run in parallel, and their threads would fight over cores.
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    stopped = patiently(stop, options.connect, options.patience)
    trusted = check_certificates(options.connect, options.certificates, "actor", name)
    with (
        end_with_any_thread(stop),
        connect(
            options.connect, options.patience, stopped, name=name, certificates=options.certificates
        ) as transport,
    ):
        keys, config = find_run(
            transport, options.run, options.patience, stopped, options.certificates
        )
        options.check_against(config)
        check = checker(trusted)
        member = Member(name, transport, keys, config, options.patience, stop, check_weights=check)
        _play(member, options)


def _play(member: Member, options: ActorOptions) -> None:
    """Plays for the run that was joined."""
    config, run = member.config, member.keys.run
    entropy = (
        [config.seed, zlib.crc32(member.name.encode()), member.incarnation]
        if options.seed is None
        else [options.seed]
    )
    seeds = np.random.SeedSequence(entropy).generate_state(1 + options.envs)
    policy_seed, *env_seeds = map(int, seeds)
    with ExitStack() as end:
        envs = [
            end.enter_context(
                closing(make_env(config, options.clock, training=not options.evaluator))
            )
            for _ in range(options.envs)
        ]
        actions = int(envs[0].action_space.n)  # type: ignore[attr-defined]
        if actions != config.action_count:
            raise InputError(
                f"{config.played} offers {actions} actions here, but the run has "
                f"{config.action_count}: install the versions of requirements.lock."
            )
        policy = Policy(
            network_of(config, actions, options),
            actions,
            np.random.default_rng(policy_seed),
            envs=options.envs,
            # Evaluations explore as in 2017: random actions are redrawn at every step.
            exploration=None if options.evaluator else config.exploration,
        )
        tell("READY=1", f"STATUS=plays for run {run} at {options.connect}")
        joined = f"joined run {run} at {options.connect}"
        member.warn(f"{joined}: plays {config.played}{options.clock}.")
        if options.evaluator:
            Evaluator(member, envs[0], policy).run(env_seeds[0])
        else:
            Actor(member, envs, policy).run(env_seeds)


def network_of(config: RunConfig, actions: int, options: ActorOptions) -> QNetwork:
    """Returns the run's network with its initial weights, as this process computes it. Raises
    InputError as `choose_kernel` does."""
    network = build_network(config, actions)
    instruction_set = _instruction_set(options, network)
    return NativeQNetwork(network, instruction_set) if instruction_set else network


def _instruction_set(
    options: ActorOptions, network: QNetwork | None = None
) -> InstructionSet | None:
    """Returns that of the compiled code for ``network``; None for PyTorch, by which evaluators
    compute. Raises InputError as `choose_kernel` does."""
    if options.evaluator:
        return None
    chosen = options.precision
    bfloat16 = bfloat16_is_faster() if chosen == "auto" else chosen == "bfloat16"
    found = choose_kernel(options.kernel, bfloat16=bfloat16, network=network)
    if found is None and chosen == "bfloat16":  # for a learner that has other hardware
        found = choose_kernel(options.kernel, bfloat16=False, network=network)
    return found


def _name_of(options: ActorOptions) -> str:
    """Returns the name of this process. Raises InputError if it cannot have the given one."""
    name = options.name
    if name is None and options.certificates is not None:
        name = own_name(options.certificates)
    name = check_name("actor", name or _default_name())
    if name == DEMONSTRATIONS:
        raise InputError(f"{name!r} stands for recorded games: choose another --name.")
    return name


def _default_name() -> str:
    """Returns the host's name and six random digits."""
    host = socket.gethostname().split(".")[0]
    host = "".join(c if c.isascii() and c.isalnum() else "-" for c in host)
    return f"{host.strip('-')[:40] or 'actor'}-{secrets.token_hex(3)}"

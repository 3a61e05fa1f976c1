"""A whole run in one process: an actor plays, the replay stores, the learner learns."""

import io
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Discrete

from actors.actor import Actor
from actors.envs import make_env
from actors.member import Member
from actors.policy import Policy
from common.network import build_network
from common.registry import Registry
from common.run.folder import RunFolder
from common.run.join import find_run
from common.run.rules import check_config
from common.settings.config import RunConfig
from common.transport.interface import Transport
from common.transport.signature import unsigned
from learner.algorithm.interface import build_algorithm
from learner.assembly import build_learner
from learner.device import Device
from learner.options import LearnerOptions
from learner.telemetry.sinks.display import PlainDisplay
from replay.replay_buffer import ReplayBuffer
from replay.server import ReplayServer
from tests.in_process_transport import InProcessHub
from tests.patience import PATIENCE

RUN = "extended"


@contextmanager
def added(registry: Registry[Any], entry: Any) -> Iterator[None]:
    """``entry`` is in ``registry`` for the block."""
    registry.add(entry)
    try:
        yield
    finally:
        del registry._entries[entry.name]


def learned(
    config: RunConfig,
    runs: Path,
    steps: int,
    *,
    run: str = RUN,
    keep_snapshots: bool = False,
    connect: Callable[[], Transport] | None = None,
) -> tuple[dict[str, Any], Policy]:
    """The summary of a run of so many steps, and the policy that acted in it.

    ``connect`` gives learner and actor a transport each; without it they meet at an `InProcessHub`.
    """
    check_config(config)
    folder = RunFolder(runs, run)
    folder.path.mkdir()
    device = Device(torch.device("cpu"), bfloat16=False)
    stop = threading.Event()
    with ExitStack() as stack:
        connect = connect or InProcessHub().connect
        hub, client = (stack.enter_context(connect()) for _ in range(2))
        buffer = ReplayBuffer(config, folder.replay)
        stack.callback(buffer.close)
        stack.enter_context(ReplayServer(hub, buffer, config, run))
        network = build_network(config, config.action_count)
        learner = build_learner(
            LearnerOptions(config, run=run, runs=runs, steps=steps, keep_snapshots=keep_snapshots),
            folder,
            hub,
            buffer,
            build_algorithm(config, network, device),
            device,
            PlainDisplay(io.StringIO()),
            threading.Event(),
            sign=unsigned,
        )
        keys, announced = find_run(client, run, PATIENCE)
        assert announced == config
        actions = announced.action_count
        env = make_env(announced, training=True)
        stack.callback(env.close)
        assert isinstance(env.action_space, Discrete)
        assert env.action_space.n == actions
        policy = Policy(build_network(announced, actions), actions, np.random.default_rng(1))
        member = Member("a", client, keys, announced, PATIENCE, stop)
        actor = Actor(member, [env], policy)
        acting = threading.Thread(target=actor.run, args=([1],))
        acting.start()
        try:
            learner.start()
            learner.run()
        finally:
            stop.set()
            acting.join(PATIENCE)
        assert learner.phases.done
    summary: dict[str, Any] = json.loads(folder.summary.read_text())
    return summary, policy

"""`python -m benchmarks.lab.live_views`: what it costs an actor to be watched."""

import statistics
import threading
import time
from dataclasses import dataclass, replace
from typing import get_args

import cv2
import torch

from actors.envs import make_env
from actors.loop import play
from actors.member import Member
from actors.policy import Policy
from actors.stream.live_views import LiveViews
from benchmarks.child import free_endpoint
from benchmarks.report import BenchmarkOptions, Report, main
from common.checked import FromOne
from common.protocol.live_view import Viewpoint, ViewRequest
from common.protocol.run_keys import RunKeys
from common.settings.presets import PRESETS
from common.transport.chosen import connect, open_hub

_SETTLING = 50
"""Steps before the first picture."""
_IDLE = 100_000


@dataclass(frozen=True, kw_only=True)
class Options(BenchmarkOptions):
    """Time the pictures of an actor from each viewpoint, and a step without any; one thread."""

    looks: FromOne = 5
    """Number of pictures from each viewpoint."""


def measure(options: Options) -> Report:
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    rows = [row for env in ("robot", "ale") for row in _looks(env, options.looks)]
    title = "processor time that an actor spends on a look, and what it sends"
    return Report.of(title, rows, {"looks": options.looks})


def _looks(env_name: str, looks: int) -> list[dict[str, object]]:
    config = replace(PRESETS["robot"], env=env_name)
    env, endpoint, keys = make_env(config, training=True), free_endpoint(), RunKeys("r")
    with open_hub(endpoint) as hub, connect(endpoint, 10.0) as client:
        member = Member("a", client, keys, config, 10.0, threading.Event())
        policy = Policy.of_file(config, None, 1.0, 0)
        views = LiveViews(member, "actor", [env], policy)
        requester = hub.requester(keys.view("actor", "a"), 60.0)
        steps = play([env], policy, [1])
        for _ in range(_SETTLING):
            step = next(steps)
        began = time.process_time()
        for _ in range(_IDLE):
            views.show(step)
        idle = (time.process_time() - began) / _IDLE
        rows = [_row(env_name, "nobody looks", idle, 0)]
        for viewpoint in get_args(Viewpoint) if env_name == "robot" else ("none",):
            spent: list[float] = []
            sent = 0
            for _ in range(looks):
                answer = requester.request(ViewRequest(0, viewpoint).encode())
                took = 0.0
                while not answer.done():  # until it has come, and the actor's rest is over
                    step = next(steps)
                    began = time.process_time()
                    views.show(step)
                    took = max(took, time.process_time() - began)
                spent.append(took)
                sent = max(sent, len(answer.result().payload))
            rows.append(_row(env_name, viewpoint, statistics.median(spent), sent))
    env.close()
    return rows


def _row(env: str, viewpoint: str, seconds: float, sent: int) -> dict[str, object]:
    return {"env": env, "viewpoint": viewpoint, "ms": 1e3 * seconds, "most bytes": sent}


if __name__ == "__main__":
    main("lab.live_views", Options, measure)

"""One Double DQN update in plain PyTorch, and as the learner does it, for `benchmarks.peers`."""

import copy
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from torch import nn
from torch.nn.functional import smooth_l1_loss

from common.network import build_network
from common.settings.presets import PRESETS
from learner.algorithm.interface import DeviceBatch, build_algorithm
from learner.device import choose_device
from learner.prefetch import to_device
from replay.batch import Batch

_FAST = PRESETS["fast"]
DOUBLE_DQN = replace(
    _FAST,
    learning=replace(
        _FAST.learning,
        algorithm="dqn",
        initial_weights="torch",
        layer_norm=False,
        frame_differences=False,
    ),
)
"""The fast preset, with the algorithm and the layers that other libraries have too."""
_ACTIONS = 6
_SIZE = 32


def noise_batch(size: int, device: torch.device) -> DeviceBatch:
    """Returns a minibatch of noise; the content of frames does not affect the time."""
    rng = np.random.default_rng(1)
    states = rng.integers(256, size=(2, size, 4, 84, 84), dtype=np.uint8)
    return to_device(
        Batch(
            ids=np.arange(size),
            s_tm1=states[0],
            a_tm1=rng.integers(_ACTIONS, size=size, dtype=np.uint8),
            r_t=rng.standard_normal(size, np.float32),
            discount_t=np.full(size, 0.97, np.float32),
            s_t=states[1],
            weights=np.ones(size, np.float32),
            x_tm1=np.zeros((size, 0), np.float32),
            x_t=np.zeros((size, 0), np.float32),
        ),
        device,
    )


def ours() -> Callable[[], float]:
    """Returns the learner's update, on the device and in the precision that it chooses itself."""
    device = choose_device("auto", "auto")
    algorithm = build_algorithm(DOUBLE_DQN, build_network(DOUBLE_DQN, _ACTIONS), device)
    batch = noise_batch(_SIZE, device.torch)

    def action() -> float:
        return float(algorithm.update(algorithm.prepare(batch)).loss)

    return action


def eager() -> Callable[[], float]:
    """Returns a textbook update with the same network, loss and optimizer, on the same device."""
    learning = DOUBLE_DQN.learning
    device = choose_device("auto", "float32").torch
    online = nn.Sequential(
        nn.Conv2d(4, 32, 8, stride=4),
        nn.ReLU(),
        nn.Conv2d(32, 64, 4, stride=2),
        nn.ReLU(),
        nn.Conv2d(64, 64, 3),
        nn.ReLU(),
        nn.Flatten(),
        nn.Linear(64 * 7 * 7, 512),
        nn.ReLU(),
        nn.Linear(512, _ACTIONS),
    ).to(device)
    target = copy.deepcopy(online)
    optimizer = torch.optim.Adam(
        online.parameters(), lr=learning.learning_rate, eps=learning.optimizer_epsilon
    )
    batch = noise_batch(_SIZE, device)

    def action() -> float:
        s_tm1, s_t = batch.s_tm1.float() / 255, batch.s_t.float() / 255
        with torch.no_grad():
            best = online(s_t).argmax(dim=1, keepdim=True)
            goal = batch.r_t + batch.discount_t * target(s_t).gather(1, best).squeeze(1)
        q = online(s_tm1).gather(1, batch.a_tm1[:, None]).squeeze(1)
        loss = smooth_l1_loss(q, goal)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(online.parameters(), learning.gradient_norm)
        optimizer.step()
        return loss.item()

    return action

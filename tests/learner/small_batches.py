"""Minibatches of random content, for tests that only need some."""

import torch

from learner.algorithm.trainer import DeviceBatch


def random_batch(size: int = 8, actions: int = 6, seed: int = 0) -> DeviceBatch:
    generator = torch.Generator().manual_seed(seed)

    def frames() -> torch.Tensor:
        return torch.randint(256, (size, 4, 84, 84), dtype=torch.uint8, generator=generator)

    return DeviceBatch(
        s_tm1=frames(),
        a_tm1=torch.randint(actions, (size,), generator=generator),
        r_t=torch.randn(size, generator=generator),
        discount_t=torch.full((size,), 0.9),
        s_t=frames(),
        weights=torch.ones(size),
        x_tm1=torch.zeros(size, 0),
        x_t=torch.zeros(size, 0),
    )

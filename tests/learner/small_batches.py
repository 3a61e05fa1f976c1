"""Minibatches of random content for tests that only need some, and an update with one."""

import torch

from learner.algorithm.interface import Algorithm, DeviceBatch, Update


def random_batch(size: int = 8, actions: int = 6, seed: int = 0, width: int = 0) -> DeviceBatch:
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
        x_tm1=torch.randn(size, width, generator=generator),
        x_t=torch.randn(size, width, generator=generator),
    )


def learn(algorithm: Algorithm, batch: DeviceBatch) -> Update:
    """One update with ``batch``, as the prefetcher and the training loop make it together."""
    return algorithm.update(algorithm.prepare(batch))

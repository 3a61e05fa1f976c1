"""What the learner sends to all actors, and when."""

from types import SimpleNamespace
from typing import Any

import torch
from safetensors.torch import load

from common.protocol.wire import decode_version
from learner.broadcast import Broadcast


def test_weights_are_signed_with_their_version_and_their_run() -> None:
    network = torch.nn.Linear(1, 1, bias=False)
    signed: list[Any] = []
    sent: list[tuple[bytes, bytes]] = []

    def sign(*told: Any) -> bytes:
        signed.append(told)
        return b"signature"

    algorithm: Any = SimpleNamespace(published=network)
    broadcast = Broadcast(
        algorithm, "run's id", lambda *told: sent.append(told), sign, now=lambda: 0.0
    )
    assert broadcast.version == 0
    torch.nn.init.constant_(network.weight, 3.0)
    broadcast.send(7)

    assert broadcast.version == 7
    ((weights, version),) = sent
    assert load(weights)["weight"].item() == 3.0
    assert signed == [("training", 7, "run's id", weights)]
    assert decode_version(version, "run's id") == (7, b"signature")


def test_it_is_due_at_first_and_ten_seconds_after_the_last() -> None:
    algorithm: Any = SimpleNamespace(published=torch.nn.Linear(1, 1))
    time = 100.0
    broadcast = Broadcast(
        algorithm, "id", lambda *told: None, sign=lambda *told: b"", now=lambda: time
    )
    assert broadcast.is_due()
    time = 105.0
    broadcast.send(1)
    time = 114.9
    assert not broadcast.is_due()
    time = 115.0
    assert broadcast.is_due()

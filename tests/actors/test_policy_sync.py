"""An actor plays only by weights that the learner of its run has signed."""

import shutil
import threading
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from actors.member import Member
from actors.policy import Policy
from actors.policy_sync import PolicySync
from common.network import QNetwork
from common.protocol.ack import Ack
from common.protocol.run_keys import RunKeys
from common.protocol.weights import encode_weights
from common.protocol.wire import encode_version
from common.settings.presets import PRESETS
from common.transport.credentials import Credentials
from common.transport.interface import Envelope, Transport
from common.transport.signature import Sign, checker, signer, unsigned
from tests.patience import wait_until

KEYS = RunKeys("r", "id")


def test_without_weights_all_play_is_random(hub: Transport, client: Transport) -> None:
    """As where actors join a replay before its learner, which begins with a network of its own."""
    exploration = replace(PRESETS["fast"].exploration, start=0.05)
    config = replace(PRESETS["fast"], exploration=exploration)
    policy = Policy(QNetwork(6), 6, np.random.default_rng(0))
    member = Member(
        *("a", client, KEYS, config, 0.0, threading.Event(), 1),
        check_weights=lambda *_: None,
        tell=lambda _: None,
    )
    sync = PolicySync(member, policy)
    ack = Ack("stored", False, False, 0, 1.0, 3)
    sync.follow(ack)
    assert policy.epsilon == 1.0
    weights = encode_weights(QNetwork(6))
    answer = Envelope(weights, encode_version(3, "id", b""))
    with closing(hub.serve(KEYS.latest_weights, lambda _: answer)):

        def follows() -> bool:
            sync.follow(ack)
            return policy.weights_version == 3

        wait_until(follows, "the weights are fetched")
    assert policy.epsilon == 0.05


def test_a_hub_that_was_taken_over_cannot_forge_weights(
    hub: Transport, client: Transport, certificates: Path, tmp_path: Path
) -> None:
    hubs = shutil.copytree(certificates, tmp_path / "hubs")
    for end in (".pem", "-key.pem"):
        shutil.copy(hubs / f"hub{end}", hubs / f"learner{end}")
    true, forged = encode_weights(QNetwork(6)), encode_weights(QNetwork(6))
    warnings: list[str] = []
    policy = Policy(QNetwork(6), 6, np.random.default_rng(0))
    member = Member(
        *("a", client, KEYS, PRESETS["fast"], 0.0, threading.Event(), 1),
        check_weights=checker(Credentials.find(certificates, "actor")),
        tell=warnings.append,
    )
    sync, publisher = PolicySync(member, policy), hub.publisher(KEYS.weights)

    def publish(version: int, weights: bytes, sign: Sign, signed: bytes | None = None) -> None:
        told = ("training", version, "id", weights if signed is None else signed)
        publisher.publish(weights, encode_version(version, "id", sign(*told)))

    def taken(what: str) -> None:
        def look() -> bool:
            sync.take_weights()
            return any(what in each for each in warnings)

        wait_until(look, what)

    def taken_version() -> int:
        sync.take_weights()
        return policy.weights_version

    publish(3, true, signer(certificates))
    wait_until(taken_version, "the learner's are taken")
    for version, sign, signed, why in (
        (4, unsigned, None, "they are not signed"),
        (5, signer(hubs), None, "their signer's certificate is not that of a learner"),
        (6, signer(certificates), true, "their signature does not fit"),
    ):
        publish(version, forged, sign, signed)
        taken(f"a: weights {version} were not used: {why}")
    assert policy.weights_version == 3
    assert encode_weights(policy.network) == true

"""What the process of an actor plays by."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from actors.options import ActorOptions
from actors.policy import Policy
from actors.process import network_of
from common.errors import InputError
from common.native.kernel import NEEDS, PrecisionChoice
from common.native.network import NativeQNetwork
from common.network import build_network
from common.protocol.weights import load_weights
from common.run.network_file import encode_network_file
from common.settings.presets import PRESETS
from tests.native import NEEDS_NATIVE, needs_native

pytestmark = NEEDS_NATIVE
CONFIG = PRESETS["robot"]


@pytest.mark.parametrize(
    ("options", "native"),
    [
        (ActorOptions(kernel="native"), True),
        (ActorOptions(kernel="torch"), False),
        (ActorOptions(evaluator=True), False),
        (ActorOptions(evaluator=True, kernel="torch"), False),
    ],
)
def test_training_actors_alone_play_by_the_native_kernel(
    options: ActorOptions, native: bool
) -> None:
    assert isinstance(network_of(CONFIG, 6, options), NativeQNetwork) is native


@pytest.mark.parametrize(
    ("cpu_name", "precision", "dtype"),
    [
        ("AMD EPYC", "auto", torch.bfloat16),
        ("AMD EPYC", "float32", torch.float32),
        ("Intel Xeon", "auto", torch.float32),
        ("Intel Xeon", "bfloat16", torch.bfloat16),
    ],
)
@needs_native("avx512_bf16")
def test_it_plays_in_the_precision_that_is_faster_or_asked_for(
    cpu_name: str,
    precision: PrecisionChoice,
    dtype: torch.dtype,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    has = dict.fromkeys(NEEDS["avx512_bf16"], True)
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: has | {"cpu_name": cpu_name})
    network = network_of(CONFIG, 6, ActorOptions(precision=precision))
    assert isinstance(network, NativeQNetwork)
    assert network.dtype == dtype


@pytest.mark.parametrize("more", [{"avx512_bf16": False}, {"amx_bf16": True}])
@needs_native("avx512_bf16")
def test_where_bfloat16_is_not_for_the_kernel_it_plays_in_float32(
    more: dict[str, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    has = dict.fromkeys(NEEDS["avx512_bf16"], True) | more
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: has)
    network = network_of(CONFIG, 6, ActorOptions(precision="bfloat16"))
    assert isinstance(network, NativeQNetwork)
    assert network.dtype == torch.float32


def test_a_network_that_the_kernel_does_not_fit_is_pytorchs() -> None:
    small = replace(CONFIG, learning=replace(CONFIG.learning, network="nips"))
    assert not isinstance(network_of(small, 6, ActorOptions()), NativeQNetwork)


def test_an_evaluator_with_a_kernel_or_precision_is_refused() -> None:
    with pytest.raises(InputError, match="computes by PyTorch: omit --kernel native"):
        ActorOptions(evaluator=True, kernel="native").check()
    with pytest.raises(InputError, match="computes in float32: omit --precision bfloat16"):
        ActorOptions(evaluator=True, precision="bfloat16").check()


def test_new_weights_are_played_at_once() -> None:
    torch.manual_seed(7)
    fresh = build_network(CONFIG, 6)
    with torch.no_grad():
        for parameter in fresh.parameters():
            parameter.normal_(0, 0.05)
    policy = Policy(
        network_of(CONFIG, 6, ActorOptions(kernel="native")), 6, np.random.default_rng(0)
    )
    load_weights(policy.network, encode_network_file(fresh, CONFIG))
    frames = torch.randint(0, 256, (2, 4, 84, 84), dtype=torch.uint8)
    with torch.no_grad():
        expected = fresh(frames, torch.zeros(2, 0))
    played = policy.q_values(frames.numpy(), torch.zeros(2, 0).numpy())
    torch.testing.assert_close(torch.from_numpy(played), expected, rtol=0.05, atol=0.02)

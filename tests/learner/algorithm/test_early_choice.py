"""Next actions that the online network chooses ahead of their update."""

import threading
from dataclasses import replace

import pytest
import torch

from common.network import QNetwork
from common.settings.config import LearningConfig
from learner.algorithm.double_dqn import double_dqn
from learner.algorithm.early_choice import EarlyChoice
from learner.algorithm.qr_dqn import qr_dqn
from learner.algorithm.value_based import ValueBased
from learner.device import Device
from tests.learner.small_batches import learn, random_batch
from tests.native import INSTRUCTION_SETS

EARLY = LearningConfig(early_choice=True, learning_rate=1e-2)
FLOAT32 = Device(torch.device("cpu"), bfloat16=False)
BFLOAT16 = Device(torch.device("cpu"), bfloat16=True)


@pytest.fixture(params=[None, *INSTRUCTION_SETS])
def device(request: pytest.FixtureRequest) -> Device:
    """Those that compute with other weights than those that an update changes."""
    if request.param is None:
        return BFLOAT16
    return replace(BFLOAT16, native=request.param, bfloat16=request.param == "avx512_bf16")


def algorithm(device: Device, config: LearningConfig = EARLY, atoms: int = 1) -> ValueBased:
    torch.manual_seed(0)
    make = qr_dqn if atoms > 1 else double_dqn
    return make(QNetwork(6, atoms=atoms, vector_width=3), config, device)


@pytest.mark.parametrize("atoms", [1, 5])
def test_an_early_choice_is_that_of_the_weights_which_were_there(
    device: Device, atoms: int
) -> None:
    early, late = algorithm(device, atoms=atoms), algorithm(device, atoms=atoms)
    batches = [random_batch(size=33, seed=seed, width=3) for seed in range(4)]
    for each in early, late:
        learn(each, batches[0])  # the first weights are packed when the network is built
    prepared = early.prepare(batches[1], ahead=True)
    assert prepared.q_t is not None
    assert torch.equal(early.update(prepared).td_errors, learn(late, batches[1]).td_errors)
    # Prepared before the last update, it chooses by the weights of then.
    prepared = early.prepare(batches[3], ahead=True)
    assert prepared.q_t is not None
    values = early._precision.network(prepared.pixels_t, prepared.batch.x_t)
    assert torch.equal(prepared.q_t, values)
    learn(early, batches[2])
    values = early._precision.network(prepared.pixels_t, prepared.batch.x_t)
    assert not torch.equal(prepared.q_t, values)


def test_what_chooses_decides_the_target() -> None:
    """The action that the prepared values choose, not that of the present network."""
    config = replace(EARLY, target_update_period=1_000_000)
    one = algorithm(BFLOAT16, config)
    prepared = one.prepare(random_batch(width=3), ahead=True)
    (q_t_target,), batch = prepared.target_outputs, prepared.batch
    for action in range(6):
        chosen = torch.zeros(len(batch.r_t), 6)
        chosen[:, action] = 1.0
        targets = one.update(prepared._replace(q_t=chosen)).targets
        expected = batch.r_t + batch.discount_t * q_t_target[:, action]
        torch.testing.assert_close(targets, expected)


@pytest.mark.parametrize(
    ("changed", "where", "ahead"),
    [
        ({}, BFLOAT16, False),  # no other minibatch waits: the update may as well do it
        ({"early_choice": False}, BFLOAT16, True),
        ({"target": "dqn"}, BFLOAT16, True),
        ({}, FLOAT32, True),  # its weights change meanwhile
    ],
)
def test_otherwise_the_update_chooses(
    changed: dict[str, object], where: Device, ahead: bool
) -> None:
    one = algorithm(where, replace(EARLY, **changed))  # type: ignore[arg-type]
    assert one.prepare(random_batch(width=3), ahead=ahead).q_t is None


def test_a_gpu_does_not_choose_early() -> None:
    gpu = Device(torch.device("cuda"), bfloat16=True)
    assert EarlyChoice.of(QNetwork(6), EARLY, gpu) is None
    assert EarlyChoice.of(QNetwork(6), EARLY, BFLOAT16) is not None


def test_it_reads_no_weights_while_an_update_writes_them(device: Device) -> None:
    one = algorithm(device)
    early, prepared = one._early_choice, one.prepare(random_batch(width=3))
    assert early is not None
    done = threading.Event()

    def choose() -> None:
        early.values(prepared)
        done.set()

    reader = threading.Thread(target=choose)
    with early.writing:
        reader.start()
        assert not done.wait(0.2)
    assert done.wait(60)
    reader.join()
    held = []
    step = one._optimizer.step

    def stepped(loss: torch.Tensor) -> None:
        held.append(early.writing.locked())
        step(loss)

    one._optimizer.step = stepped  # type: ignore[method-assign]
    learn(one, random_batch(width=3))
    assert held == [True]
    assert not early.writing.locked()

"""The compiled layers against PyTorch's.

Whole numbers of up to eight bits are exact in bfloat16. A network of such weights and pixels, whose
activations and gradients are all such numbers too, must give exactly what PyTorch gives in float32.
"""

import gc
import resource
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from common.native.library import InstructionSet
from common.native.network import NativeQNetwork
from common.network import QNetwork
from common.settings.config import LearningConfig
from tests.common.test_network import frames_of
from tests.native import INSTRUCTION_SETS, torch_threads

_ALL = [1, 2, 3, 4, 5, 31, 32, 33, 65]
"""Numbers of states below, at and above those that are computed together."""


def whole_network(seed: int, width: int = 0) -> QNetwork:
    """Returns a network of few weights, all of them -1 or 1, and no scaling of the pixels."""
    torch.manual_seed(seed)
    learning = LearningConfig(scale_pixels=False, center_pixels=False, layer_norm=False)
    network = QNetwork(6, vector_width=width, learning=learning)
    with torch.no_grad():
        for name, parameter in network.named_parameters():
            few = 0.3 if "bias" in name else 3 / parameter[0].numel()
            kept = torch.rand_like(parameter) < few
            parameter.copy_(kept * (1 - 2 * (torch.rand_like(parameter) < 0.5).float()))
    return network


def whole_frames(states: int) -> Tensor:
    return frames_of(states) % 3


def layers_of(network: QNetwork) -> list[nn.Conv2d | nn.Linear]:
    return [*(m for m in network.convolutions if isinstance(m, nn.Conv2d)), network.hidden]


def gradients_of(network: QNetwork) -> list[Tensor]:
    found = []
    for layer in layers_of(network):
        for parameter in layer.parameters():
            assert parameter.grad is not None
            found.append(parameter.grad.clone())
    return found


@pytest.fixture(params=INSTRUCTION_SETS)
def instruction_set(request: pytest.FixtureRequest) -> InstructionSet:
    chosen: InstructionSet = request.param
    return chosen


@pytest.fixture
def threads(request: pytest.FixtureRequest) -> Iterator[None]:
    with torch_threads(request.param):
        yield


@pytest.mark.parametrize("threads", [1, 3], indirect=True)
@pytest.mark.parametrize("states", _ALL)
@pytest.mark.parametrize("width", [0, 5])
def test_whole_numbers_give_exactly_what_pytorch_gives(
    states: int, width: int, threads: None, instruction_set: InstructionSet
) -> None:
    network = whole_network(1, width)
    frames = whole_frames(states)
    vectors = torch.randint(-2, 3, (states, width)).float()
    # Few of the outputs have a gradient, so that no sum needs more than eight bits.
    towards = (torch.rand(states, 512) < 4 / 512).float()

    inputs: list[Tensor] = []
    hooks = [m.register_forward_hook(lambda *a: inputs.append(a[2])) for m in network.convolutions]
    expected = network.hidden_units(frames, vectors)
    for hook in hooks:
        hook.remove()
    for each in inputs:
        assert torch.equal(each, each.bfloat16().float())
        each.retain_grad()
        assert each.abs().max() > 0
    (expected * towards).sum().backward()  # type: ignore[no-untyped-call]
    for each in inputs:
        assert each.grad is not None
        assert torch.equal(each.grad, each.grad.bfloat16().float())
    gradients = gradients_of(network)
    assert all(each.abs().max() > 0 for each in gradients)

    native = NativeQNetwork(network, instruction_set)
    for _ in range(2):  # a second update finds memory that the first one has used
        network.zero_grad()
        with torch.no_grad():
            assert torch.equal(native.hidden_units(frames, vectors), expected)
        units = native.hidden_units(native.as_pixels(frames), vectors)
        assert torch.equal(units, expected)
        (units * towards).sum().backward()  # type: ignore[no-untyped-call]
        native.backward()
        for ours, theirs in zip(gradients_of(network), gradients, strict=True):
            assert torch.equal(ours, theirs)


def test_fewer_states_than_before_find_nothing_of_those(instruction_set: InstructionSet) -> None:
    network = whole_network(2)
    used, empty = NativeQNetwork(network, instruction_set), torch.zeros(65, 0)
    used.hidden_units(torch.full((65, 4, 84, 84), 255, dtype=torch.uint8), empty).sum().backward()  # type: ignore[no-untyped-call]
    used.backward()
    for states in (34, 33, 5, 3, 1):
        found = []
        for native in (used, NativeQNetwork(network, instruction_set)):
            network.zero_grad()
            units = native.hidden_units(whole_frames(states), empty[:states])
            units.square().sum().backward()  # type: ignore[no-untyped-call]
            native.backward()
            found.append([units, *gradients_of(network)])
        for ours, theirs in zip(*found, strict=True):
            assert torch.equal(ours, theirs)


def test_two_backward_passes_are_the_same_to_the_last_bit(instruction_set: InstructionSet) -> None:
    """Threads that add up in another order would round otherwise."""
    torch.manual_seed(1)
    network = QNetwork(6)
    native = NativeQNetwork(network, instruction_set)
    found = []
    with torch_threads(3):
        for _ in range(5):
            network.zero_grad()
            native.hidden_units(frames_of(40), torch.zeros(40, 0)).square().sum().backward()  # type: ignore[no-untyped-call]
            native.backward()
            found.append(gradients_of(network))
    for each in found[1:]:
        assert all(torch.equal(*pair) for pair in zip(each, found[0], strict=True))


def test_the_backward_pass_may_have_more_threads_than_the_forward_pass(
    instruction_set: InstructionSet,
) -> None:
    network = whole_network(3)
    found = []
    for threads in (1, 3):
        native = NativeQNetwork(network, instruction_set)
        network.zero_grad()
        with torch_threads(1):
            units = native.hidden_units(whole_frames(6), torch.zeros(6, 0))
            units.sum().backward()  # type: ignore[no-untyped-call]
        with torch_threads(threads):
            native.backward()
        found.append(gradients_of(network))
    for ours, theirs in zip(*found, strict=True):
        torch.testing.assert_close(ours, theirs)  # three shares of the states are added up


@pytest.mark.parametrize("differences", [False, True])
@pytest.mark.parametrize("center", [False, True])
def test_pixels_are_those_of_pytorch_in_blocks(
    differences: bool, center: bool, instruction_set: InstructionSet
) -> None:
    learning = LearningConfig(frame_differences=differences, center_pixels=center)
    network = QNetwork(6, learning=learning)
    frames = frames_of(5)
    frames[1], frames[2] = 0, 255
    frames[3, :, :42], frames[3, :, 42:] = 0, 1  # whose mean of ½ is rounded to 0
    frames[4, :, :42], frames[4, :, 42:] = 1, 2  # and this one's to 2
    expected = network.as_pixels(frames).reshape(5, 4, 21, 4, 21, 4).permute(0, 2, 4, 1, 3, 5)
    found = NativeQNetwork(network, instruction_set).as_pixels(frames).float()
    assert torch.equal(found, expected.reshape(5, 21, 21, 64))


def test_real_weights_come_as_near_as_the_numbers_can(instruction_set: InstructionSet) -> None:
    torch.manual_seed(3)
    learning = LearningConfig(
        layer_norm=True, frame_differences=True, center_pixels=True, initial_weights="he"
    )
    network = QNetwork(6, vector_width=40, learning=learning, atoms=32)
    frames, vectors = frames_of(32), torch.randn(32, 40)
    native = NativeQNetwork(network, instruction_set)
    found, expected = native(frames, vectors), network(frames, vectors)
    rounds = instruction_set == "avx512_bf16"
    assert (found - expected).norm() / expected.norm() < (0.01 if rounds else 1e-5)
    expected.square().sum().backward()
    theirs = [p.grad for p in network.parameters()]
    network.zero_grad()
    found.square().sum().backward()
    native.backward()
    for ours, their in zip((p.grad for p in network.parameters()), theirs, strict=True):
        assert ours is not None
        assert their is not None
        # Noise as pictures leaves many activations near 0, of which some change their sign.
        assert (ours - their).norm() / their.norm() < (0.15 if rounds else 5e-3)
        assert torch.nn.functional.cosine_similarity(ours.flatten(), their.flatten(), 0) > 0.99


def test_weights_that_are_not_numbers_are_seen(instruction_set: InstructionSet) -> None:
    """A maximum of 0 and such a number could be 0, and a run would go on with them."""
    for layer in range(4):
        network = whole_network(4)
        with torch.no_grad():
            layers_of(network)[layer].weight[0] = float("nan")
        values = NativeQNetwork(network, instruction_set)(whole_frames(2), torch.zeros(2, 0))
        assert values.isnan().any()


def test_it_computes_with_the_weights_of_the_last_pack(instruction_set: InstructionSet) -> None:
    network, frames, empty = whole_network(5), whole_frames(2), torch.zeros(2, 0)
    native = NativeQNetwork(network, instruction_set)
    before = native.hidden_units(frames, empty).detach().clone()
    native.backward()
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.mul_(2)
    with torch.no_grad():
        assert torch.equal(native.hidden_units(frames, empty), before)
        native.pack()
        assert torch.equal(native.hidden_units(frames, empty), network.hidden_units(frames, empty))


def test_it_takes_over_weights_that_are_loaded_into_it_or_into_its_master(
    instruction_set: InstructionSet,
) -> None:
    master, frames, empty = whole_network(5), whole_frames(2), torch.zeros(2, 0)
    native = NativeQNetwork(master, instruction_set)
    for seed, loaded in ((6, master), (7, native)):
        loaded.load_state_dict(whole_network(seed).state_dict())
        with torch.no_grad():
            expected = whole_network(seed).hidden_units(frames, empty)
            assert torch.equal(native.hidden_units(frames, empty), expected)
            assert torch.equal(master.hidden_units(frames, empty), expected)


def test_a_loss_of_two_passes_has_the_gradients_of_both(instruction_set: InstructionSet) -> None:
    torch.manual_seed(6)
    network = QNetwork(6, vector_width=3)
    frames, vectors = frames_of(8), torch.randn(8, 3)

    def loss(of: QNetwork) -> Tensor:
        both = of(frames[:4], vectors[:4]) * of(frames[4:], vectors[4:])
        return torch.sum(both)

    loss(network).backward()  # type: ignore[no-untyped-call]
    expected, rounds = gradients_of(network), instruction_set == "avx512_bf16"
    native = NativeQNetwork(network, instruction_set)
    for _ in range(2):
        network.zero_grad()
        loss(native).backward()  # type: ignore[no-untyped-call]
        native.backward()
        for ours, theirs in zip(gradients_of(network), expected, strict=True):
            assert (ours - theirs).norm() / theirs.norm() < (0.08 if rounds else 1e-5)


@pytest.mark.parametrize(
    "frames",
    [
        torch.zeros(2, 3, 84, 84, dtype=torch.uint8),
        torch.zeros(2, 4, 80, 84, dtype=torch.uint8),
        torch.zeros(4, 84, 84, dtype=torch.uint8),
        torch.zeros(2, 4, 84, 84, dtype=torch.int64),
        torch.zeros(2, 4, 84, 84),
        torch.zeros(2, 21, 21, 64, dtype=torch.float64),
        torch.zeros(2, 21, 21, 32),
        torch.zeros(2, 21, 21, 32, dtype=torch.bfloat16),
    ],
)
def test_other_shapes_and_types_are_refused(
    frames: Tensor, instruction_set: InstructionSet
) -> None:
    with pytest.raises(ValueError, match="pixels"):
        NativeQNetwork(whole_network(6), instruction_set).hidden_units(
            frames, torch.zeros(len(frames), 0)
        )


def test_pixels_of_another_type_are_not_made(instruction_set: InstructionSet) -> None:
    native = NativeQNetwork(whole_network(6), instruction_set)
    other = torch.bfloat16 if native.dtype == torch.float32 else torch.float32
    assert native.as_pixels(whole_frames(1), native.dtype).dtype == native.dtype
    for wrong in (other, torch.float64):
        with pytest.raises(ValueError, match="no pixels of"):
            native.as_pixels(whole_frames(1), wrong)


def test_vectors_of_another_shape_are_refused(instruction_set: InstructionSet) -> None:
    native = NativeQNetwork(whole_network(6, width=2), instruction_set)
    for shape in ((1, 2), (2, 0), (2, 3)):
        with pytest.raises(ValueError, match="vectors"):
            native.hidden_units(whole_frames(2), torch.zeros(shape))


def test_frames_and_pixels_may_be_parts_of_others(instruction_set: InstructionSet) -> None:
    native = NativeQNetwork(whole_network(6), instruction_set)
    frames, empty = whole_frames(6), torch.zeros(3, 0)
    with torch.no_grad():
        expected = native.hidden_units(frames[::2].clone(), empty)
        assert torch.equal(native.hidden_units(frames[::2], empty), expected)
        assert torch.equal(native.hidden_units(native.as_pixels(frames)[::2], empty), expected)


def test_a_loss_without_the_layers_gives_them_no_gradient(instruction_set: InstructionSet) -> None:
    network = whole_network(7)
    native = NativeQNetwork(network, instruction_set)
    native.backward()
    native.hidden_units(whole_frames(1), torch.zeros(1, 0))
    native.backward()
    assert all(p.grad is None for p in network.parameters())


def test_only_the_layers_that_the_code_knows_are_its() -> None:
    class Other(QNetwork):
        pass

    assert NativeQNetwork.fits(QNetwork(3, vector_width=7, atoms=8))
    assert not NativeQNetwork.fits(QNetwork(3, learning=LearningConfig(network="nips")))
    assert not NativeQNetwork.fits(QNetwork(3, frame_stack=3))
    assert not NativeQNetwork.fits(Other(3))
    assert not NativeQNetwork.fits(nn.Linear(3, 3))  # a registered algorithm's own
    coarser = QNetwork(3)
    layers_of(coarser)[2].stride = (2, 2)
    assert not NativeQNetwork.fits(coarser)


def _in_rows(network: QNetwork) -> QNetwork:
    for parameter in network.parameters():
        parameter.data = parameter.data.contiguous()
    return network


def test_weights_that_the_code_cannot_read_are_refused(instruction_set: InstructionSet) -> None:
    with pytest.raises(ValueError, match="bfloat16 or in another layout"):
        NativeQNetwork(QNetwork(6).bfloat16(), instruction_set)
    with pytest.raises(ValueError, match="another layout"):
        NativeQNetwork(_in_rows(QNetwork(6)), instruction_set)
    with pytest.raises(ValueError, match="not the layers"):
        NativeQNetwork(QNetwork(6, frame_stack=3), instruction_set)


def test_its_memory_is_freed(instruction_set: InstructionSet) -> None:
    def resident_bytes() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

    NativeQNetwork(whole_network(8), instruction_set)
    gc.collect()
    before = resident_bytes()
    for _ in range(15):  # each of them keeps 4 to 7 MB
        NativeQNetwork(whole_network(8), instruction_set)
        gc.collect()
    assert resident_bytes() - before < 30e6

"""The network, against a plain one written from the paper's sentence about it."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor
from torch.nn.functional import conv2d, linear, relu

from common.network import QNetwork, build_network
from common.settings.conditions import PlayConfig
from common.settings.config import InitialWeights, LearningConfig
from common.settings.presets import PRESETS


def frames_of(batch: int, frame_stack: int = 4, seed: int = 0) -> Tensor:
    rng = torch.Generator().manual_seed(seed)
    return torch.randint(256, (batch, frame_stack, 84, 84), dtype=torch.uint8, generator=rng)


def network_of(
    seed: int = 0,
    actions: int = 6,
    frame_stack: int = 4,
    vector_width: int = 0,
    **settings: float | bool | str,
) -> QNetwork:
    torch.manual_seed(seed)
    learning = LearningConfig(**settings)  # type: ignore[arg-type]
    return QNetwork(actions, frame_stack, vector_width, learning)


def plain(
    network: QNetwork, frames: Tensor, vectors: Tensor, scale: float, *, center: bool = False
) -> Tensor:
    """Mnih et al. 2015: 32 8×8 stride 4, 64 4×4 stride 2, 64 3×3 stride 1, 512, actions."""
    weights = {
        name: value.detach().clone(memory_format=torch.contiguous_format)
        for name, value in network.named_parameters()
    }
    names = iter(weights.values())
    x = frames.to(torch.float32)
    if center:
        x = torch.stack([state - state.mean().round() for state in x])
    x = x * scale
    for stride in (4, 2, 1):
        x = relu(conv2d(x, next(names), next(names), stride=stride))
    x = torch.cat((x.reshape(len(x), -1), vectors), dim=1)
    x = relu(linear(x, next(names), next(names)))
    return linear(x, next(names), next(names))


def plain_of_2013(network: QNetwork, frames: Tensor, scale: float) -> Tensor:
    """Mnih et al. 2013: 16 8×8 stride 4, 32 4×4 stride 2, 256, actions."""
    w = [value.detach().contiguous() for value in network.parameters()]
    x = relu(conv2d(frames.to(torch.float32) * scale, w[0], w[1], stride=4))
    x = relu(conv2d(x, w[2], w[3], stride=2)).reshape(len(frames), 32 * 9 * 9)
    return linear(relu(linear(x, w[4], w[5])), w[6], w[7])


@pytest.mark.parametrize("center", [False, True])
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_frames_but_the_oldest_are_differences(center: bool, dtype: torch.dtype) -> None:
    frames = frames_of(3)
    frames[0, 1], frames[0, 2] = 0, 255  # the largest there are
    kept = frames.clone()
    network = network_of(frame_differences=True, center_pixels=center)
    found = network.as_pixels(frames, dtype)
    assert torch.equal(frames, kept)
    assert found.dtype == dtype
    for state in range(3):
        oldest = frames[state, 0].double()
        mean = oldest.mean().round() if center else 0.0
        assert torch.equal(found[state, 0].double(), oldest - mean)
        for frame in (1, 2, 3):
            moved = frames[state, frame].double() - frames[state, frame - 1].double()
            assert torch.equal(found[state, frame].double(), moved)


def test_values_of_differences_are_those_of_the_plain_network_of_them() -> None:
    network = network_of(frame_differences=True)
    frames, none = frames_of(2), torch.zeros(2, 0)
    plainly = frames.float()
    plainly[:, 1:] = plainly[:, 1:] - plainly[:, :-1].clone()
    torch.testing.assert_close(network(frames, none), plain(network, plainly, none, 1 / 255))


def test_the_hidden_units_are_normalised_before_they_are_rectified() -> None:
    network = network_of(layer_norm=True, initial_weights="he")
    assert network.norm is not None
    torch.nn.init.normal_(network.norm.weight)
    torch.nn.init.normal_(network.norm.bias)
    seen: list[Tensor] = []
    network.hidden.register_forward_hook(lambda *args: seen.append(args[2].detach()))
    frames = frames_of(3)
    values = network(frames, torch.zeros(3, 0))
    (hidden,) = seen
    for state in range(3):
        unit = hidden[state].double()
        deviation = ((unit - unit.mean()).square().mean() + 1e-5).sqrt()
        plainly = (unit - unit.mean()) / deviation * network.norm.weight + network.norm.bias
        expected = network.actions.weight.double() @ plainly.clamp(min=0) + network.actions.bias
        torch.testing.assert_close(values[state].double(), expected, rtol=1e-4, atol=1e-5)


def test_the_network_of_2013_agrees_with_a_plain_one() -> None:
    network = network_of(network="nips")
    by_hand = (16 * 4 * 64 + 16) + (32 * 16 * 16 + 32) + (2592 * 256 + 256) + (256 * 6 + 6)
    assert sum(weight.numel() for weight in network.parameters()) == by_hand
    frames = frames_of(3)
    torch.testing.assert_close(
        network(frames, torch.zeros(3, 0)), plain_of_2013(network, frames, 1 / 255)
    )


@pytest.mark.parametrize("actions", [4, 6, 18])
@pytest.mark.parametrize("batch", [1, 3])
def test_one_value_for_each_action_of_each_state(batch: int, actions: int) -> None:
    values = network_of(actions=actions)(frames_of(batch), torch.zeros(batch, 0))
    assert values.shape == (batch, actions)
    assert values.dtype == torch.float32


def test_the_outputs_of_an_action_lie_side_by_side() -> None:
    network = QNetwork(2, atoms=3)
    with torch.no_grad():
        network.actions.weight.zero_()
        network.actions.bias.copy_(torch.arange(6.0))
    told = frames_of(1), torch.zeros(1, 0)
    assert network.atoms(*told).tolist() == [[[0, 1, 2], [3, 4, 5]]]
    assert network(*told).tolist() == [[1, 4]]


def test_the_number_of_weights_is_that_of_the_paper() -> None:
    by_hand = (
        (32 * 4 * 8 * 8 + 32)
        + (64 * 32 * 4 * 4 + 64)
        + (64 * 64 * 3 * 3 + 64)
        + (3136 * 512 + 512)
        + (512 * 6 + 6)
    )
    assert by_hand == 1_687_206
    assert sum(weight.numel() for weight in network_of().parameters()) == by_hand


@pytest.mark.parametrize(
    ("scale_pixels", "center", "scale"),
    [(True, False, 1 / 255), (False, False, 1.0), (True, True, 1 / 64), (False, True, 1.0)],
)
@pytest.mark.parametrize(("frame_stack", "width"), [(4, 0), (4, 7), (2, 0)])
def test_it_computes_what_the_plain_network_computes(
    scale_pixels: bool, center: bool, scale: float, frame_stack: int, width: int
) -> None:
    network = network_of(
        frame_stack=frame_stack,
        vector_width=width,
        scale_pixels=scale_pixels,
        center_pixels=center,
    )
    frames = frames_of(5, frame_stack)
    vectors = torch.randn(5, width, generator=torch.Generator().manual_seed(1))
    frames[0] //= 2  # Another mean than the other states'.
    expected = plain(network, frames, vectors, scale, center=center)
    with torch.no_grad():
        torch.testing.assert_close(network(frames, vectors), expected, rtol=1e-4, atol=1e-4)


def test_its_gradients_are_those_of_the_plain_network() -> None:
    network = network_of()
    frames = frames_of(2)
    network(frames, torch.zeros(2, 0)).square().sum().backward()
    weight = network.convolutions[0].weight
    assert isinstance(weight, torch.nn.Parameter)
    assert weight.grad is not None
    # A small move of one weight changes the plain network's loss by gradient × move.
    where = tuple(int(at) for at in torch.nonzero(weight.grad == weight.grad.max())[0])
    moved, step = [], 1e-3
    for sign in (1, -1):
        with torch.no_grad():
            weight[where] += sign * step
            moved.append(plain(network, frames, torch.zeros(2, 0), 1 / 255).square().sum().item())
            weight[where] -= sign * step
    slope = (moved[0] - moved[1]) / (2 * step)
    assert weight.grad[where].item() == pytest.approx(slope, rel=0.05)


@pytest.mark.parametrize("center", [False, True])
def test_frames_that_are_pixels_already_give_the_same_values(center: bool) -> None:
    network, frames = network_of(center_pixels=center), frames_of(3)
    with torch.no_grad():
        bare = network(frames, torch.zeros(3, 0))
        assert torch.equal(network(network.as_pixels(frames), torch.zeros(3, 0)), bare)


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_pixels_keep_their_values_in_the_layout_of_the_first_weights(dtype: torch.dtype) -> None:
    every = torch.arange(256, dtype=torch.uint8).reshape(1, 4, 8, 8)
    network = network_of()
    found = network.as_pixels(every, dtype)
    assert found.dtype == dtype
    assert (found == every).all()
    for each in (found, *network.convolutions[0].parameters()):
        assert each.ndim == 1 or each.is_contiguous(memory_format=torch.channels_last)


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_pixels_are_centered_state_by_state_without_rounding_errors(dtype: torch.dtype) -> None:
    rising = torch.arange(256, dtype=torch.uint8).reshape(1, 4, 8, 8)  # Mean 127.5.
    dark = torch.zeros_like(rising)
    dark[0, 3, 7, 7] = 255  # Mean 0.996.
    found = network_of(center_pixels=True).as_pixels(torch.cat((rising, dark)), dtype)
    assert found.dtype == dtype
    assert (found[0].float() == rising[0].float() - 128).all()
    assert (found[1].float() == dark[0].float() - 1).all()


def test_a_vector_changes_the_values() -> None:
    network, frames = network_of(vector_width=3), frames_of(1)
    with torch.no_grad():
        one = network(frames, torch.zeros(1, 3))
        other = network(frames, torch.tensor([[0.0, 1.0, 0.0]]))
    assert not torch.allclose(one, other)


def test_bfloat16_comes_close() -> None:
    network, frames = network_of(), frames_of(8)
    with torch.no_grad():
        exact = network(frames, torch.zeros(8, 0))
        with torch.autocast("cpu", dtype=torch.bfloat16):
            rough = network(frames, torch.zeros(8, 0))
    assert rough.dtype == torch.float32
    assert not torch.equal(rough, exact)
    # bfloat16 keeps 8 bits: errors of a few hundredths of the values' size.
    torch.testing.assert_close(rough, exact, rtol=0.05, atol=0.01)


def test_glorot_draws_between_its_bounds_with_zero_biases() -> None:
    fans = {
        "convolutions.0": (4 * 64, 32 * 64),
        "convolutions.2": (32 * 16, 64 * 16),
        "convolutions.4": (64 * 9, 64 * 9),
        "hidden": (3136, 512),
        "actions": (512, 6),
    }
    weights = dict(network_of(initial_weights="glorot").named_parameters())
    assert len(weights) == 2 * len(fans)
    for layer, (fan_in, fan_out) in fans.items():
        bound = math.sqrt(6 / (fan_in + fan_out))
        weight = weights[f"{layer}.weight"]
        assert 0.95 * bound < weight.abs().max().item() <= bound
        assert weight.std().item() == pytest.approx(bound / math.sqrt(3), rel=0.05)
        assert (weights[f"{layer}.bias"] == 0).all()


def test_a_black_screen_is_worth_exactly_nothing_to_fresh_glorot_weights() -> None:
    values = network_of(initial_weights="glorot")(
        torch.zeros(2, 4, 84, 84, dtype=torch.uint8), torch.zeros(2, 0)
    )
    assert (values == 0).all()


def test_he_draws_with_his_deviation_and_zero_biases() -> None:
    """He et al. 2015, equation 10: a variance of 2 / fan-in; here a tenth in the last layer."""
    network = network_of(initial_weights="he")
    fans = {"convolutions.0": 256, "convolutions.2": 512, "convolutions.4": 576, "hidden": 3136}
    weights = dict(network.named_parameters())
    for layer, fan_in in fans.items():
        expected = math.sqrt(2 / fan_in)
        assert weights[f"{layer}.weight"].std().item() == pytest.approx(expected, rel=0.05)
        assert weights[f"{layer}.weight"].abs().max().item() > 3 * expected  # normal, not uniform
    last = weights["actions.weight"].std().item()
    assert last == pytest.approx(0.1 * math.sqrt(2 / 512), rel=0.05)
    assert all((weights[name] == 0).all() for name in weights if name.endswith("bias"))


@pytest.mark.parametrize("initial", ["torch", "he"])
def test_what_distinguishes_pictures_reaches_the_hidden_units_with_hes_weights(
    initial: InitialWeights,
) -> None:
    """What `QNetwork._initialise` says of the two."""
    network = network_of(initial_weights=initial, center_pixels=True)
    pixels = torch.randn(64, 4, 84, 84)
    seen: list[Tensor] = []
    network.hidden.register_forward_hook(lambda *args: seen.append(args[2].detach()))
    network(pixels * 64, torch.zeros(64, 0))
    differences = (seen[0] - seen[0].mean(dim=0)).std().item()
    if initial == "he":
        assert 0.3 < differences < 3
    else:
        assert differences < 0.05


def test_the_seed_of_the_run_makes_the_first_weights() -> None:
    # Drawn by PyTorch, biases too; He's are 0.
    fast = PRESETS["fast"]
    config = replace(fast, learning=replace(fast.learning, initial_weights="torch"))
    torch.manual_seed(5)
    one = build_network(config, 6).state_dict()
    torch.manual_seed(6)
    other = build_network(config, 6).state_dict()
    third = build_network(replace(config, seed=2), 6).state_dict()
    for name, weight in one.items():
        assert torch.equal(weight, other[name])
        assert torch.equal(weight, third[name]) == name.startswith("norm.")


def test_building_leaves_the_random_state_alone() -> None:
    before = torch.random.get_rng_state()
    build_network(PRESETS["fast"], 6)
    assert torch.equal(torch.random.get_rng_state(), before)


def test_the_configuration_shapes_the_network() -> None:
    fast = PRESETS["fast"]
    for center, scale in ((False, 1 / 255), (True, 1 / 64)):
        learning = replace(fast.learning, center_pixels=center)
        assert build_network(replace(fast, learning=learning), 6).pixel_scale == scale
    learning = replace(
        fast.learning,
        center_pixels=False,
        frame_differences=True,
        layer_norm=True,
        initial_weights="he",
    )
    found, frames = build_network(replace(fast, learning=learning), 6), frames_of(1)
    assert torch.equal(
        found.as_pixels(frames), network_of(frame_differences=True).as_pixels(frames)
    )
    assert found.norm is not None
    assert found.actions.weight.std().item() == pytest.approx(0.1 * (2 / 512) ** 0.5, rel=0.1)
    paper = build_network(replace(PRESETS["paper"], play=PlayConfig(frame_stack=3)), 4)
    assert paper.pixel_scale == 1
    shapes = [tuple(weight.shape) for weight in paper.parameters()]
    assert shapes[0] == (32, 3, 8, 8)
    assert shapes[-1] == (4,)
    assert all((bias == 0).all() for name, bias in paper.named_parameters() if "bias" in name)

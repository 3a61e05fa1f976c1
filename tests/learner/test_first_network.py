"""Networks that begin a run whose proprioception is another than their own."""

from pathlib import Path

import numpy as np
import pytest
import torch

from common.command_line.run_options import parse_run
from common.errors import InputError
from common.network import QNetwork, build_network
from common.run.network_file import encode_network_file
from common.settings.config import RunConfig
from learner.first_network import read_network
from learner.options import LearnerOptions

KEYS_AND_COMMANDS = 6 * 18 + 4 * 5
VECTOR = ("--play.vector",)
NO_JOINTS = (*VECTOR, "--play.no-vector-joints")
ROBOTROLLER = (*VECTOR, "--robot", "robotroller")
ALE = ("--env", "ale")


def config(flags: tuple[str, ...]) -> RunConfig:
    """Returns the settings of a run that has ``flags``, of the robot unless they say otherwise."""
    given = ["--env", "robot", *flags]
    return parse_run(LearnerOptions, "learner", given, lambda _: None).config


def kept(trained: RunConfig, folder: Path) -> tuple[QNetwork, Path]:
    network = build_network(trained, trained.action_count)
    file = folder / "network.safetensors"
    file.write_bytes(encode_network_file(network, trained))
    return network, file


def begun_with(file: Path, *flags: str) -> LearnerOptions:
    given = ["--env", "robot", "--initial", str(file), *flags]
    return parse_run(LearnerOptions, "learner", given, lambda _: None)


def values(network: QNetwork, told: int) -> np.ndarray:
    """Returns Q-values of four random states, with a vector of which ``told`` numbers are not 0."""
    random = torch.Generator().manual_seed(3)
    frames = torch.randint(0, 256, (4, 4, 84, 84), generator=random, dtype=torch.uint8)
    width = network.hidden.weight.shape[1] - 3_136  # pixels' features
    vectors = torch.zeros(4, width)
    vectors[:, :told] = torch.rand(4, KEYS_AND_COMMANDS + 16, generator=random)[:, :told]
    with torch.no_grad():
        found: np.ndarray = network(frames, vectors).numpy()
    return found


@pytest.mark.parametrize(
    ("before", "now", "shared"),
    [
        ((), VECTOR, 0),
        ((), ALE, 0),
        (VECTOR, VECTOR, KEYS_AND_COMMANDS + 16),
        (VECTOR, NO_JOINTS, KEYS_AND_COMMANDS),
        (NO_JOINTS, VECTOR, KEYS_AND_COMMANDS),
        (VECTOR, ROBOTROLLER, KEYS_AND_COMMANDS),
        ((*ALE, *VECTOR), VECTOR, KEYS_AND_COMMANDS),
    ],
)
def test_it_plays_as_before_by_what_both_are_told(
    before: tuple[str, ...], now: tuple[str, ...], shared: int, tmp_path: Path
) -> None:
    network, file = kept(config(before), tmp_path)
    found = read_network(file, config(now))
    assert found.hidden.weight.shape[1] == 3_136 + config(now).vector_width
    assert not found.hidden.weight[:, 3_136 + shared :].any()
    np.testing.assert_allclose(values(found, shared), values(network, shared), rtol=1e-5, atol=1e-6)


def test_histories_that_grow_keep_what_was_told_of_the_same_time(tmp_path: Path) -> None:
    longer = ("--play.vector-commands", "8", "--play.vector-key-frames", "5")
    before, now = config(VECTOR), config((*VECTOR, *longer, "--play.vector-forecast", "3"))
    network, file = kept(before, tmp_path)
    old, new = network.hidden.weight, read_network(file, now).hidden.weight
    assert new.shape[1] == 3_136 + 8 * 18 + 5 * 5 + 16 + 3 * 7
    expected = [
        old[:, :3_136],
        torch.zeros(512, 2 * 18),  # the commands of 7 and 8 agent steps ago
        old[:, 3_136 : 3_136 + 6 * 18],
        torch.zeros(512, 5),  # the keys of 5 frames ago
        old[:, 3_136 + 6 * 18 :],
        torch.zeros(512, 3 * 7),
    ]
    assert torch.equal(new, torch.cat(expected, 1))


def test_histories_that_shrink_lose_what_was_told_of_long_ago(tmp_path: Path) -> None:
    long = ("--play.vector-commands", "2", "--play.vector-key-frames", "3")
    short = ("--play.vector-commands", "1", "--play.vector-key-frames", "2")
    before = config((*VECTOR, *long, "--play.vector-forecast", "3"))
    now = config((*NO_JOINTS, *short, "--play.vector-forecast", "2"))
    network, file = kept(before, tmp_path)
    old, new = network.hidden.weight, read_network(file, now).hidden.weight
    expected = [
        old[:, :3_136],
        old[:, 3_136 + 18 : 3_136 + 36],
        old[:, 3_136 + 36 + 5 : 3_136 + 51],
        old[:, 3_136 + 51 + 16 : 3_136 + 51 + 16 + 14],
    ]
    assert torch.equal(new, torch.cat(expected, 1))


@pytest.mark.parametrize(
    ("before", "now", "advice"),
    [
        (VECTOR, (), "give --play.vector"),
        ((*ALE, *NO_JOINTS), ALE, "give --play.vector"),
        ((), (*VECTOR, "--play.frame-stack", "3"), "give --play.frame-stack 4"),
    ],
)
def test_what_it_cannot_do_without_is_told(
    before: tuple[str, ...], now: tuple[str, ...], advice: str, tmp_path: Path
) -> None:
    _, file = kept(config(before), tmp_path)
    with pytest.raises(InputError, match=advice):
        read_network(file, config(now))


OTHER_LAYERS = (
    *("--learning.algorithm", "qr_dqn", "--learning.quantiles", "9"),
    *("--learning.network", "nips", "--learning.layer-norm"),
    *("--learning.no-scale-pixels", "--learning.no-center-pixels"),
)


@pytest.mark.parametrize("other", [OTHER_LAYERS, ("--learning.algorithm", "dqn")])
@pytest.mark.parametrize("differences", ["", "no-"])
def test_a_run_has_the_layers_of_the_network_that_it_begins_with_and_else_its_preset(
    other: tuple[str, ...], differences: str, tmp_path: Path
) -> None:
    layers = (*other, f"--learning.{differences}frame-differences")
    network, file = kept(config((*layers, "--learning.n-step", "7", "--seed", "5")), tmp_path)
    options = begun_with(file, "--seed", "6")
    assert options.config == config((*layers, "--seed", "6"))
    options.check()
    found = read_network(file, options.config)
    for name, values in network.state_dict().items():
        assert torch.equal(found.state_dict()[name], values)


def test_a_flag_for_other_layers_than_those_it_begins_with_is_refused(tmp_path: Path) -> None:
    _, file = kept(config(OTHER_LAYERS), tmp_path)
    asked = begun_with(file, "--learning.quantiles", "8").config
    with pytest.raises(InputError, match=r"9 outputs.*8 outputs.*give --learning.quantiles 9\."):
        read_network(file, asked)


def test_what_is_played_is_not_the_networks_choice(tmp_path: Path) -> None:
    _, file = kept(config(("--game", "breakout", *VECTOR)), tmp_path)
    assert begun_with(file).config == config(())

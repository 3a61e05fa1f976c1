"""What a network needs of the settings under which it is used."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from common.errors import InputError
from common.registry import ALGORITHMS, ENVIRONMENTS, AlgorithmKind, Environment
from common.settings.config import RunConfig
from common.settings.fit import check_fit
from common.settings.own_settings import own_settings
from common.settings.presets import PRESETS
from tests.extending.whole_run import added

TRAINED = replace(PRESETS["robot"], play=replace(PRESETS["robot"].play, vector=True))
FILE = Path("p.safetensors")


def changed(setting: str, value: Any) -> RunConfig:
    """`TRAINED` with another value of ``setting``."""
    group, _, name = setting.rpartition(".")
    if not group:
        return replace(TRAINED, **{name: value})
    inner = replace(getattr(TRAINED, group), **{name: value})
    return replace(TRAINED, **{group: inner})


@pytest.mark.parametrize(
    ("setting", "value", "words"),
    [
        ("play.vector", False, "144 numbers of .* have 0 numbers of .*: give --play.vector"),
        ("play.robot", "robotroller", "here it would have 134 numbers of .*: give --robot nao"),
        ("env", "ale", "144 numbers .* 128 numbers .*: give --env robot"),
        ("play.vector_commands", 9, r"give --play\.vector-commands 6"),
        ("game", "breakout", "6 actions, .* 4 .*: give --game pong, or name a network of breakout"),
        ("play.minimal_actions", False, r"6 actions, .* 18 actions: give --play\.minimal-actions"),
        ("play.frame_stack", 3, r"4 frames per state, .* 3 frames .*: give --play\.frame-stack 4"),
        (
            *("learning.network", "nips"),
            r"of nature, normalised, .* of nips, normalised: give --learning\.network nature",
        ),
        (
            *("learning.center_pixels", False),
            r"pixels that are scaled, centred and differenced, .* scaled and differenced: "
            r"give --learning\.center-pixels",
        ),
        (
            *("learning.scale_pixels", False),
            r"scaled, centred and differenced, .* centred and differenced: "
            r"give --learning\.scale-pixels",
        ),
        (
            *("learning.frame_differences", False),
            r"scaled, centred and differenced, .* scaled and centred: "
            r"give --learning\.frame-differences",
        ),
        (
            *("learning.layer_norm", False),
            r"layers of nature, normalised, .* of nature: give --learning\.layer-norm",
        ),
        ("learning.algorithm", "dqn", r"51 outputs per .*: give --learning\.algorithm qr_dqn"),
    ],
)
def test_a_network_of_another_shape_says_the_flag_under_which_it_fits(
    setting: str, value: Any, words: str
) -> None:
    with pytest.raises(InputError, match=rf"^p\.safetensors, which plays pong .*{words}\.$"):
        check_fit(FILE, TRAINED, changed(setting, value))


def test_a_flag_is_quoted_as_a_shell_needs_it() -> None:
    trained = changed("play.robot", "my hand.npz")
    with pytest.raises(InputError, match=r": give --robot 'my hand\.npz'\.$"):
        check_fit(FILE, trained, changed("play.robot", "robotroller"))


def test_all_that_does_not_fit_is_told_at_once() -> None:
    learning = TRAINED.learning
    raw = replace(learning, scale_pixels=False, center_pixels=False, frame_differences=False)
    words = (
        r"with 144 numbers of proprioception, pixels that are scaled, centred and differenced, "
        r"and here it would have 0 numbers of proprioception, pixels that are as they are: "
        r"give --play\.vector --learning\.scale-pixels --learning\.center-pixels "
        r"--learning\.frame-differences\.$"
    )
    with pytest.raises(InputError, match=words):
        check_fit(FILE, TRAINED, replace(changed("play.vector", False), learning=raw))


@dataclass(frozen=True)
class Sized:
    size: int = 3
    name: str = ""


def test_settings_that_an_extension_declares_shape_its_network_too() -> None:
    def size(text: str) -> int:
        return own_settings(Sized, text).size

    env = Environment(
        "sized",
        "nowhere:sized",
        lambda config: size(config.play.env_settings),
        lambda play: size(play.env_settings),
        settings=Sized,
    )
    algorithm = AlgorithmKind(
        "deep",
        "nowhere:deep",
        atoms=lambda learning: size(learning.algorithm_settings),
        settings=Sized,
    )
    trained = replace(
        TRAINED,
        env="sized",
        play=replace(TRAINED.play, env_settings="size=5 name='a b'"),
        learning=replace(TRAINED.learning, algorithm="deep", algorithm_settings="size=5"),
    )
    other = replace(
        trained,
        play=replace(trained.play, env_settings=""),
        learning=replace(trained.learning, algorithm_settings="size=2"),
    )
    words = (
        r"with 5 actions, 5 numbers of proprioception, 5 outputs per action, and here it would "
        r"have 3 actions, 3 numbers of proprioception, 2 outputs per action: give "
        r"--play\.env-settings 'size=5 name='\"'\"'a b'\"'\"'' "
        r"--learning\.algorithm-settings size=5\.$"
    )
    with added(ENVIRONMENTS, env), added(ALGORITHMS, algorithm):
        check_fit(FILE, trained, trained)
        with pytest.raises(InputError, match=words):
            check_fit(FILE, trained, other)


@pytest.mark.parametrize(
    ("setting", "value"),
    [("game", "space_invaders"), ("play.sticky", 0.25), ("learning.n_step", 7), ("seed", 9)],
)
def test_what_does_not_change_its_shape_is_free(setting: str, value: Any) -> None:
    check_fit(FILE, TRAINED, changed(setting, value))


def test_a_network_of_unknown_origin_is_not_judged_by_it() -> None:
    check_fit(FILE, None, TRAINED)

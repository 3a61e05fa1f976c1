"""Settings that an extension declares for itself, as one text."""

import math
import shlex
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import pytest
from annotated_types import Ge, Le
from hypothesis import given
from hypothesis import strategies as st

from common.checked import Amount, Patience, Values
from common.errors import InputError
from common.exit_codes import BAD_INPUT
from common.registry import ALGORITHMS, ROBOTS, AlgorithmKind
from common.run.rules import check_config
from common.settings.conditions import PlayConfig
from common.settings.config import LearningConfig, RunConfig
from common.settings.own_settings import ROBOT, in_full, merged, own_settings
from tests.extending.whole_run import added


@dataclass(frozen=True)
class Kind:
    depth: Annotated[int, Ge(1), Le(9)] = 3
    kappa: Amount = 1.0
    dueling: bool = False
    name: str = "none"
    mode: Literal["max", "mean"] = "max"


def test_what_is_not_named_has_its_default() -> None:
    assert own_settings(Kind, "") == Kind()
    assert own_settings(Kind, "kappa=0.5 depth=4") == Kind(depth=4, kappa=0.5)
    assert own_settings(Kind, "dueling=true mode=mean") == Kind(dueling=True, mode="mean")
    assert own_settings(Kind, "kappa=.5").kappa == 0.5


def test_a_text_stays_a_text() -> None:
    assert own_settings(Kind, "name=5").name == "5"
    assert own_settings(Kind, "name='two words' depth=1").name == "two words"
    assert own_settings(Kind, "name=a=b").name == "a=b"


@dataclass(frozen=True)
class Other:
    size: int
    patience: Patience = 1.0
    layers: Values[int] = field(default_factory=lambda: (1, 2))
    order: Literal[1, 2] = 2
    digit: Literal["1", "2"] = "2"
    title: str | None = None


def test_a_number_is_written_as_in_other_flags() -> None:
    assert own_settings(Kind, "kappa=.5") == own_settings(Kind, "kappa=+5e-1") == Kind(kappa=0.5)
    assert own_settings(Other, "size=1 patience=inf") == Other(1, patience=math.inf)


def test_what_may_be_a_text_is_not_taken_for_a_number() -> None:
    found = own_settings(Other, "size=1 order=1 digit=1 title=nan")
    assert found == Other(1, order=1, digit="1", title="nan")


def test_a_setting_may_be_a_list_and_have_no_default() -> None:
    assert own_settings(Other, "size=1") == Other(1)
    assert own_settings(Other, "layers=[3] size=1") == Other(1, layers=(3,))
    with pytest.raises(InputError, match=r"^s has a missing or unknown field: size\.$"):
        own_settings(Other, "", "s")


UNFINISHED = "a quotation mark, or what follows a backslash, is missing."


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("depth=10", "s.depth is 10: choose at most 9."),
        ("depth=2.5", "s.depth is 2.5, which is not a whole number."),
        ("depth=two", "s.depth is 'two', which is not a whole number."),
        ("kappa=NaN", "s.kappa is nan: choose a finite number."),
        ("kappa=-1", "s.kappa is -1: choose 0 or more."),
        ("dueling=1", "s.dueling is 1, which is not true or false."),
        ("mode=min", "s.mode is 'min': choose 'max' or 'mean'."),
        ("kapa=1", "s has no 'kapa': did you mean kappa?"),
        ("depth", "s has 'depth': write name=value."),
        ("depth=1 depth=1", "s has depth twice: omit one of them."),
        ("kappa=1e999", "s.kappa is inf: choose a finite number."),
        ("depth=1\0", r"s.depth is '1\x00', which is not a whole number."),
        ("depth=\x1b", r"s.depth is '\x1b', which is not a whole number."),
        ('name="\ud800"', r"s.name is '\ud800', which is not what it should be."),
        (
            f"depth={'[' * 10**5}",
            f"s.depth is '{'[' * 12}...{'[' * 13}', which is not a whole number.",
        ),
        ("name='a", f's is "name=\'a": {UNFINISHED}'),
        ("name=a\\", rf"s is 'name=a\\': {UNFINISHED}"),
        (
            f"name={'a' * 201}",
            "s.name is 'aaaaaaaaaaaa...aaaaaaaaaaaaa': choose at most 200 characters.",
        ),
    ],
)
def test_what_is_wrong_is_told(text: str, sentence: str) -> None:
    with pytest.raises(InputError) as error:
        own_settings(Kind, text, "s")
    assert str(error.value) == sentence


@dataclass(frozen=True)
class Judging:
    """Settings that judge each other, as they can only after all are known."""

    size: int = 1
    parts: int = 1

    def __post_init__(self) -> None:
        if self.size < 0:
            raise TypeError("a size counts something")
        if self.size % self.parts:
            raise ValueError("size should be a multiple of parts")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("size=-1", "s is 'size=-1': a size counts something."),
        ("parts=0", "s is 'parts=0': integer modulo by zero."),
        ("size=3 parts=2", "size should be a multiple of parts."),
    ],
)
def test_what_a_declaration_refuses_by_itself_is_told(text: str, sentence: str) -> None:
    with pytest.raises(InputError) as error:
        own_settings(Judging, text, "s")
    assert (str(error.value), error.value.exit_code) == (sentence, BAD_INPUT)


def test_an_error_names_the_declaration_where_no_setting_is_named() -> None:
    with pytest.raises(InputError, match=r"^Kind has no 'deep': did you mean depth\?$"):
        own_settings(Kind, "deep=1")


DEEP = AlgorithmKind("deep", "nowhere:deep", settings=Kind)


def test_a_text_in_full_names_every_setting() -> None:
    assert in_full(DEEP, "kappa=.5") == "depth=3 kappa=0.5 dueling=false name=none mode=max"
    assert in_full(ALGORITHMS.find("dqn"), "") == ""


@given(
    st.builds(
        Kind,
        depth=st.integers(1, 9),
        kappa=st.floats(0, allow_infinity=False),
        dueling=st.booleans(),
        name=st.text(max_size=9),
    )
)
def test_a_text_in_full_is_read_back(settings: Kind) -> None:
    text = " ".join(
        f"{name}={shlex.quote(_plain(value))}" for name, value in vars(settings).items()
    )
    assert own_settings(Kind, in_full(DEEP, text)) == settings == own_settings(Kind, text)


def _plain(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


@pytest.mark.parametrize(
    ("given", "now"),
    [(None, "a=1 'b=2 3'"), ("", ""), ("b=4", "a=1 b=4"), ("a=0", "'b=2 3' a=0")],
)
def test_what_is_given_goes_over_what_is_kept(given: str | None, now: str) -> None:
    assert merged("a=1 'b=2 3'", given, "s") == now
    assert merged("", given, "s") == (given or "")


def test_an_unfinished_text_is_not_merged() -> None:
    with pytest.raises(InputError, match=r"^s is \"a='\": a quotation mark"):
        merged("a=1", "a='", "s")


def test_the_settings_in_full_are_those_of_all_extensions() -> None:
    config = RunConfig(learning=LearningConfig(algorithm="deep", algorithm_settings="depth=4"))
    with added(ALGORITHMS, DEEP):
        full = config.in_full()
    text = "depth=4 kappa=1.0 dueling=false name=none mode=max"
    assert full == replace(config, learning=replace(config.learning, algorithm_settings=text))


def test_a_text_of_settings_may_be_longer_than_others() -> None:
    long = "depth=4".ljust(2_000)
    config = RunConfig(learning=LearningConfig(algorithm="deep", algorithm_settings=long))
    with added(ALGORITHMS, DEEP):
        check_config(config)
        longer = replace(config.learning, algorithm_settings=f"{long} ")
        with pytest.raises(InputError, match="choose at most 2000 characters"):
            check_config(replace(config, learning=longer))


@given(st.text(max_size=60))
def test_no_text_ends_it_otherwise(text: str) -> None:
    with suppress(InputError):
        assert isinstance(own_settings(Kind, text), Kind)


def test_a_run_refuses_settings_that_nobody_declares() -> None:
    for config, sentence in (
        (
            RunConfig(learning=LearningConfig(algorithm_settings="kappa=1")),
            "learning.algorithm_settings is 'kappa=1', but dqn has no settings of its own: "
            "leave it empty.",
        ),
        (
            RunConfig(play=PlayConfig(robot_settings="reach=1")),
            "play.robot_settings is 'reach=1', but nao has no settings of its own: leave it empty.",
        ),
        (
            RunConfig(env="ale", play=PlayConfig(robot_settings="reach=1")),
            "play.robot_settings is 'reach=1', but nao has no settings of its own: leave it empty.",
        ),
        (
            RunConfig(env="ale", play=PlayConfig(env_settings="x=1")),
            "play.env_settings is 'x=1', but ale has no settings of its own: leave it empty.",
        ),
    ):
        with pytest.raises(InputError) as error:
            check_config(config)
        assert str(error.value) == sentence


def test_a_run_takes_those_of_its_algorithm_and_robot() -> None:
    nao = ROBOTS.find("nao")
    robot = type(nao)("tall", nao.factory, joints=nao.joints, settings=Kind)
    with added(ALGORITHMS, DEEP), added(ROBOTS, robot):
        config = RunConfig(
            learning=LearningConfig(algorithm="deep", algorithm_settings="depth=4"),
            play=PlayConfig(robot="tall", robot_settings="kappa=2"),
        )
        check_config(config)
        wrong = RunConfig(play=PlayConfig(robot="tall", robot_settings="depth=0"))
        with pytest.raises(InputError, match=r"play\.robot_settings\.depth is 0"):
            check_config(wrong)
    # A setting without a default has to be given.
    with added(ALGORITHMS, AlgorithmKind("deep", "nowhere:deep", settings=Other)):
        lacking = RunConfig(learning=LearningConfig(algorithm="deep"))
        with pytest.raises(InputError, match=r"^learning\.algorithm_settings has a missing or "):
            check_config(lacking)


def test_what_is_wrong_in_settings_that_go_on_names_them() -> None:
    with pytest.raises(InputError) as error:
        ROBOT.going_on({}, {"play.robot_settings": "name='a"})
    assert str(error.value) == f'play.robot_settings is "name=\'a": {UNFINISHED}'

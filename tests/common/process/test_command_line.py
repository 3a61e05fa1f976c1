"""Command lines: presets below flags, a resumed run's own settings below both."""

from dataclasses import dataclass, replace

import pytest

from common.errors import InputError
from common.process.command_line import RunFlags, parse, parse_run, preset_of
from common.run.config import RunConfig
from common.run.presets import PRESETS


@dataclass(frozen=True)
class Options:
    """What the program does."""

    config: RunFlags
    run: str = "r"
    """Name of the run."""
    resume: bool = False
    """Go on."""


def parsed(*arguments: str, stored: RunConfig | None = None) -> Options:
    return parse_run(
        Options, "program", arguments, lambda options: stored if options.resume else None
    )


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ([], "robot"),
        (["--env", "ale"], "fast"),
        (["--env=ale"], "fast"),
        (["--env", "robot"], "robot"),
        (["--preset", "paper"], "paper"),
        (["--preset=fast"], "fast"),
        (["--run", "r", "--preset", "fast", "--env", "robot", "--unknown"], "fast"),
        (["--pre", "paper"], "robot"),
    ],
)
def test_the_preset_is_asked_for_or_suits_the_environment(arguments: list[str], name: str) -> None:
    assert preset_of(arguments).preset == name


def test_a_preset_that_is_not_there_is_told_with_those_that_are() -> None:
    with pytest.raises(InputError, match="no preset 'best': choose one of paper, fast, robot"):
        preset_of(["--preset", "best"])


@pytest.mark.parametrize("name", list(PRESETS))
def test_a_preset_alone_is_taken_whole(name: str) -> None:
    assert parsed("--preset", name).config == PRESETS[name]  # type: ignore[index]


def test_flags_go_over_the_preset() -> None:
    options = parsed("--env", "ale", "--game", "breakout", "--learning.n-step=1", "--run", "x")
    fast = PRESETS["fast"]
    learning = replace(fast.learning, n_step=1)
    assert options == Options(replace(fast, game="breakout", learning=learning), "x")


def test_the_defaults_in_the_help_are_the_presets(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        parsed("--preset", "paper", "--help")
    assert caught.value.code == 0
    assert "0.00025" in capsys.readouterr().out


def test_a_resumed_run_keeps_its_own_settings() -> None:
    stored = replace(PRESETS["paper"], seed=7)
    assert parsed("--resume", stored=stored) == Options(stored, "r", True)
    assert parsed("--resume", "--env", "ale", stored=stored).config == stored


def test_flags_go_over_a_resumed_runs_settings() -> None:
    # The run's folder refuses them later, with both values.
    stored = replace(PRESETS["paper"], seed=7)
    found = parsed("--resume", "--game", "breakout", stored=stored).config
    assert found == replace(stored, game="breakout")


def test_resuming_what_is_not_there_is_left_to_the_run_folder() -> None:
    assert parsed("--resume", "--env", "ale").config == PRESETS["fast"]


def test_without_resume_the_stored_settings_do_not_count() -> None:
    assert parsed("--env", "ale", stored=PRESETS["paper"]).config == PRESETS["fast"]


def test_settings_that_cannot_work_are_told() -> None:
    with pytest.raises(InputError, match=r"^replay\.capacity is 5, but"):
        parsed("--replay.capacity", "5")


@pytest.mark.parametrize(
    "arguments",
    [
        ["--gmae", "pong"],
        ["--learning.target", "triple"],
        ["--seed", "one"],
        ["--seed"],
        ["pong"],
    ],
)
def test_what_is_not_understood_exits_with_2(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        parsed(*arguments)
    assert caught.value.code == 2
    assert capsys.readouterr().err


def test_plain_options_need_no_preset() -> None:
    @dataclass(frozen=True)
    class Plain:
        sync: bool = True
        envs: int = 1

    assert parse(Plain, "program", ["--no-sync", "--envs", "3"]) == Plain(False, 3)


@pytest.mark.parametrize(
    ("flags", "present"),
    [
        (["--replay.warmup", "5"], "--replay.learning-starts"),
        (["--learning.train_every=8"], "--learning.train-period"),
        (["--exploration.no-lasting"], "--exploration.no-ez-greedy"),
    ],
)
def test_a_flag_by_its_former_name_says_the_present_one(flags: list[str], present: str) -> None:
    with pytest.raises(InputError, match=rf"is called {present} now"):
        parse(Options, "program", flags)

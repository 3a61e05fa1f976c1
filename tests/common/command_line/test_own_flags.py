"""Own settings of extensions on the command line: what goes over what, and their help."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import pytest
from annotated_types import Gt, Le

from common.command_line.own_flags import going_on_from
from common.command_line.run_options import RunOptions, parse_run
from common.registry import ALGORITHMS, AlgorithmKind
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from common.settings.ranges import all_ranges
from common.settings.stored_config import to_json
from tests.extending.whole_run import added

TEXT = "--learning.algorithm-settings"


@dataclass(frozen=True)
class Settings:
    kappa: Annotated[float, Gt(0), Le(9)] = 1.0
    """Threshold of the loss,
    without a unit."""
    dueling: bool = False


@pytest.fixture(autouse=True)
def deep() -> Iterator[None]:
    with added(ALGORITHMS, AlgorithmKind("deep", "nowhere:deep", settings=Settings)):
        yield


def own(arguments: list[str], stored: RunConfig | None = None) -> str:
    """The own settings of a run that is given ``arguments``."""
    options = parse_run(RunOptions, "program", arguments, lambda _: stored)
    return options.config.learning.algorithm_settings


def deep_run(text: str) -> RunConfig:
    learning = replace(PRESETS["fast"].learning, algorithm="deep", algorithm_settings=text)
    return replace(PRESETS["fast"], learning=learning)


def test_a_run_stores_all_of_them() -> None:
    # Otherwise another version of the package, with other defaults, would change the run.
    assert own(["--learning.algorithm", "deep"]) == "kappa=1.0 dueling=false"
    assert own(["--learning.algorithm", "deep", TEXT, "kappa=.5"]) == "kappa=0.5 dueling=false"
    assert own([]) == ""


FULL = "kappa=2.0 dueling=true"


@pytest.mark.parametrize(
    ("arguments", "now"),
    [
        ([], FULL),
        ([TEXT, "kappa=3"], "kappa=3.0 dueling=true"),
        ([f"{TEXT}=kappa=3"], "kappa=3.0 dueling=true"),
        (["--learning.algorithm_settings", "kappa=3"], "kappa=3.0 dueling=true"),
        (["--learning.algorithm", "deep", TEXT, "kappa=3"], "kappa=3.0 dueling=true"),
        ([TEXT, ""], "kappa=1.0 dueling=false"),
        (["--learning.algorithm", "dqn"], ""),
    ],
)
def test_flags_go_over_those_of_a_stored_run_or_a_file(
    tmp_path: Path, arguments: list[str], now: str
) -> None:
    stored, file = deep_run(FULL), tmp_path / "config.json"
    file.write_text(to_json(stored))
    assert own(arguments, stored) == now
    assert own(["--config", str(file), *arguments]) == now
    assert own(["--config", str(file), *arguments], stored) == now


def test_a_stored_run_stays_as_it_is_when_its_package_declares_more() -> None:
    # A run is not resumed with other settings than it stored.
    assert own(["--resume"], deep_run("kappa=2.0")) == "kappa=2.0"


@pytest.mark.parametrize("given", [[], ["--randomise.all"]])
def test_settings_that_say_nothing_new_are_no_flag_for_all_ranges(given: list[str]) -> None:
    stored = deep_run(FULL)
    arguments = [*given, TEXT, "kappa=2.0 dueling=true"]
    options = parse_run(RunOptions, "program", arguments, lambda _: stored)
    assert (options.config.randomise == stored.randomise) == (not given)


def test_settings_that_say_more_hide_no_flag_for_all_ranges() -> None:
    options = parse_run(
        *(RunOptions, "program", ["--randomise.all", "--learning.algorithm=dqn"]),
        lambda _: deep_run(FULL),
    )
    assert options.config.randomise == all_ranges("ale")


def test_other_flags_are_left_alone() -> None:
    assert going_on_from({}, ["--seed", "3", "--flag"]) == ["--seed", "3", "--flag"]
    lacking = ["--seed", "3", "--env"]
    assert going_on_from({"play.env_settings": "a=1"}, lacking) == lacking


def test_a_robot_has_a_short_flag() -> None:
    before = {"play.robot": "arm", "play.robot_settings": "reach=2"}
    of_one_model = {"play.robot": "a.npz#sha256=0", "play.robot_settings": "rate=60"}
    assert going_on_from(of_one_model, ["--robot", "b.npz"]) == ["--play.robot", "b.npz"]
    assert going_on_from(of_one_model, ["--robot", "nao"])[2:] == ["--play.robot-settings", ""]
    assert going_on_from(before, ["--robot", "nao"]) == [
        *("--play.robot", "nao"),
        *("--play.robot-settings", ""),
    ]


@dataclass(frozen=True)
class Required:
    size: int
    name: str = "two words"


def test_the_help_tells_those_without_a_default_too(capsys: pytest.CaptureFixture[str]) -> None:
    with (
        added(ALGORITHMS, AlgorithmKind("sized", "nowhere:sized", settings=Required)),
        pytest.raises(SystemExit),
    ):
        own(["--learning.algorithm", "sized", "--help"])
    assert "\n\n  size (integer)\n  name='two words' (text)\n" in capsys.readouterr().out


def test_the_help_tells_them(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        own(["--learning.algorithm", "deep", "--help"])
    told = capsys.readouterr().out
    assert (
        "Settings of deep, each for --learning.algorithm-settings 'NAME=VALUE ...':\n\n"
        "  kappa=1.0 (above 0 to 9): Threshold of the loss, without a unit.\n"
        "  dueling=false (true, false)\n\nExit codes:"
    ) in told
    with pytest.raises(SystemExit):
        own(["--learning.algorithm", "dqn", "--help"])
    assert "Settings of" not in capsys.readouterr().out

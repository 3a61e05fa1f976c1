"""Command lines: presets below flags, a resumed run's own settings below both."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import pytest
from annotated_types import Ge, Lt

from common.checked import Patience
from common.command_line.parser import WeightsFile, parse
from common.command_line.run_options import RunOptions, parse_run, preset_of
from common.errors import InputError
from common.exit_codes import EXIT_CODES
from common.run.origin import SHIPPED, name_of
from common.settings.conditions import PlayConfig
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from common.settings.ranges import RandomiseConfig, all_ranges


@dataclass(frozen=True)
class Options(RunOptions):
    """What the program does."""

    run: str = "r"
    """Name of the run."""


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
    with pytest.raises(InputError, match="no preset 'zzz': choose one of paper, fast, robot, fru"):
        preset_of(["--preset", "zzz"])
    with pytest.raises(InputError, match=r"no preset 'fats': did you mean fast\?"):
        preset_of(["--preset", "fats"])


@pytest.mark.parametrize("name", list(PRESETS))
def test_a_preset_alone_is_taken_whole(name: str) -> None:
    assert parsed("--preset", name).config == PRESETS[name]  # type: ignore[index]


def test_every_program_tells_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        parsed("--version")
    assert left.value.code == 0
    assert re.fullmatch(r"ale-robot \S+\n", capsys.readouterr().out)


def test_flags_go_over_the_preset() -> None:
    options = parsed("--env", "ale", "--game", "breakout", "--learning.n-step=1", "--run", "x")
    fast = PRESETS["fast"]
    learning = replace(fast.learning, n_step=1)
    assert options == Options(replace(fast, game="breakout", learning=learning), run="x")


def test_a_robot_is_named_by_either_flag_and_its_file_gets_a_hash(tmp_path: Path) -> None:
    for flag in ("--robot", "--play.robot"):
        with pytest.raises(InputError, match="there is no robot 'atlas'"):
            parsed(flag, "atlas")
    file = tmp_path / "hand.npz"
    file.write_bytes(b"abc")
    first = parsed("--robot", str(file)).config
    assert first.play.robot.startswith(f"{file}#sha256=ba7816bf")
    # What goes on keeps its hash, whatever is in the file by now; what is named anew gets its own.
    file.write_bytes(b"abd")
    assert parsed("--resume", stored=first).config == first
    again = parsed("--resume", "--robot", str(file), stored=first).config
    assert again.play.robot.startswith(f"{file}#sha256=a52d159f")


def test_the_emulator_alone_is_played_by_no_robot_that_a_flag_chooses(tmp_path: Path) -> None:
    for name in ("robotroller", "atlas"):
        with pytest.raises(InputError, match=rf"^--robot {name} is for a robot, and --env ale has"):
            parsed("--env", "ale", "--robot", name)
    (model := tmp_path / "hand.npz").touch()  # the emulator follows it too
    parsed("--env", "ale", "--robot", str(model))
    learned = replace(PRESETS["robot"], play=replace(PlayConfig(), robot="robotroller"))
    assert parsed("--resume", "--env", "ale", stored=learned).config.play.robot == "robotroller"


def test_all_ranges_are_drawn_except_for_those_that_are_given() -> None:
    everything = all_ranges("robot")
    assert everything.noise == 8.0
    found = parsed(
        "--randomise.all", "--randomise.noise", "0", "--randomise.actuation-latency=3", "--run", "x"
    )
    ranges = replace(everything, noise=0.0, actuation_latency=3)
    assert found == Options(replace(PRESETS["robot"], randomise=ranges), run="x")
    assert parsed("--preset", "fast", "--randomise.all").config.randomise == all_ranges("ale")
    assert parsed("--preset", "fast", "--randomise.all", "--env", "robot").config.randomise == (
        everything
    )
    stored = replace(PRESETS["robot"], seed=7, randomise=RandomiseConfig(noise=1.0))
    assert parsed("--resume", "--randomise.all", stored=stored).config == replace(
        stored, randomise=everything
    )


def test_the_help_tells_of_all_ranges(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parsed("--help")
    told = capsys.readouterr().out
    assert "--randomise.all" in told
    assert "--randomise.head-pose" in told


def test_the_defaults_in_the_help_are_those_of_the_network_or_run_that_it_begins_with(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def quantiles(*flags: str, stored: RunConfig | None = None) -> str:
        with pytest.raises(SystemExit) as left:
            parsed(*flags, "--help", stored=stored)
        assert left.value.code == 0
        _, _, told = capsys.readouterr().out.partition("--learning.quantiles INT")
        return told[: told.index("--learning.network")]

    learned = replace(PRESETS["fast"], learning=replace(PRESETS["fast"].learning, quantiles=32))
    assert "(default: 51)" in quantiles()
    assert "(default: 32)" in quantiles("--resume", stored=learned)
    assert "(default: 51)" in quantiles("--initial", "nowhere")


def test_programs_without_settings_know_no_file_of_settings(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^there is no flag --config: `python -m program"):
        parse(Bounded, "program", ["--config", str(tmp_path / "card.json")])


def test_the_defaults_in_the_help_are_the_presets(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        parsed("--preset", "paper", "--help")
    assert caught.value.code == 0
    assert "0.00025" in capsys.readouterr().out


def test_a_resumed_run_keeps_its_own_settings() -> None:
    stored = replace(PRESETS["paper"], seed=7)
    assert parsed("--resume", stored=stored) == Options(stored, resume=True)
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
    with pytest.raises(InputError, match=r"^--replay\.capacity is 5, but --replay"):
        parsed("--replay.capacity", "5")


def test_plain_options_need_no_preset() -> None:
    @dataclass(frozen=True)
    class Plain:
        sync: bool = True
        envs: int = 1

    assert parse(Plain, "program", ["--no-sync", "--envs", "3"]) == Plain(False, 3)


@dataclass(frozen=True)
class Bounded:
    """What the program does."""

    games: Annotated[int, Ge(1)] = 1
    """Number of games, of which there is
    'at least' one, and which is explained
    --at-length.

    Another paragraph."""
    last_seed: Annotated[int, Ge(0), Lt(10)] | None = None
    speed: Annotated[float, Ge(0)] = 1.0
    patience: Patience = 1.0
    name: str | None = None


@pytest.mark.parametrize(
    ("flag", "value", "choose"),
    [
        ("--games", "0", "1 or more"),
        ("--last-seed", "-1", "0 or more"),
        ("--last-seed", "10", "less than 10"),
        ("--speed", "-0.5", "0 or more"),
        ("--speed", "inf", "a finite number"),
        ("--patience", "-1.0", "0 or more"),
        ("--patience", "nan", "0 or more"),
    ],
)
def test_a_flag_beyond_its_bounds_is_told(flag: str, value: str, choose: str) -> None:
    with pytest.raises(InputError, match=rf"^{flag} is {value}: choose {choose}\.$"):
        parse(Bounded, "program", [flag, value])


def test_flags_within_their_bounds_are_taken() -> None:
    assert parse(Bounded, "program", ["--last-seed", "9"]) == Bounded(last_seed=9)
    assert parse(Bounded, "program", ["--games", "1", "--speed", "0"]) == Bounded(speed=0.0)
    assert parse(Bounded, "program", ["--patience", "inf"]) == Bounded(patience=float("inf"))
    assert parse(Bounded, "program", ["--name", "n" * 1_000]) == Bounded(name="n" * 1_000)


def test_the_lines_of_a_help_text_are_joined(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "160")
    with pytest.raises(SystemExit):
        parse(Bounded, "program", ["--help"])
    lines = [line.strip("│ ") for line in capsys.readouterr().out.splitlines()]
    first = "Number of games, of which there is 'at least' one, and which is explained --at-length."
    at = next(number for number, line in enumerate(lines) if line.endswith(first))
    assert lines[at + 1 : at + 3] == ["", "Another paragraph. (default: 1)"]


@pytest.mark.parametrize("columns", ["40", "80"])
def test_the_description_fits_the_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, columns: str
) -> None:
    @dataclass(frozen=True)
    class Described:
        """First.

        A paragraph that is longer than a line, of forty columns or of eighty, and
        that stands on two lines in the code.
        """

    monkeypatch.setenv("COLUMNS", columns)
    with pytest.raises(SystemExit):
        parse(Described, "program", ["--help"])
    described = capsys.readouterr().out.partition("First.\n\n")[2].partition("\n\nExit")[0]
    assert described.split() == str(Described.__doc__).split()[1:]
    assert max(map(len, described.splitlines())) in range(int(columns) - 10, int(columns) + 1)


def test_each_exit_code_is_a_line_of_the_help_text(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parse(Bounded, "program", ["--help"])
    lines = capsys.readouterr().out.splitlines()
    table = [f"{code.number:>5}  {code.meaning}" for code in EXIT_CODES]
    at = lines.index("Exit codes:") + 2
    assert lines[at : at + len(table)] == table
    assert max(map(len, table)) <= 80


@pytest.mark.parametrize(
    ("flags", "present"),
    [
        (["--replay.warmup", "5"], "--replay.learning-starts"),
        (["--learning.train_every=8"], "--learning.train-period"),
        (["--exploration.no-lasting"], "--exploration.no-ez-greedy"),
        (["--camera.screen-jitter", "0.1"], "--randomise.screen-distance"),
    ],
)
def test_a_flag_by_its_former_name_says_the_present_one(flags: list[str], present: str) -> None:
    with pytest.raises(InputError, match=rf"is now called {present}: "):
        parse(Options, "program", flags)


@pytest.mark.parametrize(
    "flag",
    [
        "--learning.dueling",
        "--learning.watkins-cut",
        "--exploration.no-per-env",
        "--learning.vector-scale",
        "--play.release",
    ],
)
def test_a_flag_that_is_gone_is_said_to_be(flag: str) -> None:
    with pytest.raises(InputError, match=r"^--\S+ is gone, because .*: omit it\.$"):
        parse(Options, "program", [flag])


@pytest.mark.parametrize("flag", ["--play.delay", "--play.command-latency=2"])
def test_a_flag_that_is_gone_names_what_does_the_same(flag: str) -> None:
    told = r"is gone: give --play.actuation-latency, in emulator frames instead of agent steps\.$"
    with pytest.raises(InputError, match=told):
        parse(Options, "program", [flag])


def test_a_network_is_a_file_or_a_published_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @dataclass(frozen=True)
    class Shown:
        weights: WeightsFile | None = None

    monkeypatch.chdir(tmp_path)
    for name in ("robot_pong", "policies/robot_pong.safetensors", "robot_pong.safetensors"):
        weights = parse(Shown, "program", ["--weights", name]).weights
        assert weights == SHIPPED / "robot_pong.safetensors"
        assert name_of(weights) == "robot_pong"
    (tmp_path / "robot_pong.safetensors").touch()
    own = parse(Shown, "program", ["--weights", "robot_pong.safetensors"]).weights
    assert own is not None
    assert name_of(own) == str(own) == "robot_pong.safetensors"
    run = tmp_path / "runs" / "r1"
    run.mkdir(parents=True)
    with pytest.raises(InputError, match=r"^runs/r1 is not a file: .* policy: .*ale_pong, "):
        parse(Shown, "program", ["--weights", "runs/r1"])
    (run / "config.json").touch()
    with pytest.raises(InputError, match=r"^runs/r1/checkpoint\.safetensors does not exist: "):
        parse(Shown, "program", ["--weights", "runs/r1"])
    (run / "checkpoint.safetensors").touch()
    newest = Path("runs/r1/checkpoint.safetensors")
    assert parse(Shown, "program", ["--weights", "runs/r1"]).weights == newest
    with pytest.raises(
        InputError, match=r"^runs/r1/snap.* does not exist: name .*/runs/r1 for its"
    ):
        parse(Shown, "program", ["--weights", "runs/r1/snapshots/best.safetensors"])
    with pytest.raises(InputError, match=r"robot_pnog does not exist: did you mean robot_pong\?$"):
        parse(Shown, "program", ["--weights", "robot_pnog"])
    for name in ("other", "runs/robot_pong"):
        with pytest.raises(InputError, match=f"^{name} does not exist"):
            parse(Shown, "program", ["--weights", name])

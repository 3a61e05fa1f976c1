"""How time passes: what the learner's command line takes, refuses, and tells its actors."""

import errno
import os
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.numpy import save

from actors.options import ActorOptions
from common.command_line.parser import parse
from common.command_line.played import parse_played
from common.command_line.run_options import parse_run
from common.errors import InputError
from common.exit_codes import NO_ROOM
from common.process.log_lines import LOADING
from common.protocol.weights import encode_weights
from common.run.folder import RunFolder
from common.run.network_file import encode_network_file
from common.settings.clock import ClockConfig
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from common.settings.ranges import RandomiseConfig, all_ranges
from learner.__main__ import main
from learner.evaluation.__main__ import Evaluation
from learner.first_network import first_network
from learner.options import (
    LearnerOptions,
    clock_figures,
    going_on,
    join_command,
    opening,
    run_name,
    stored_config,
)
from learner.resume import resume_command
from tests.certificates import certify


def learner(*arguments: str) -> LearnerOptions:
    options = parse_run(LearnerOptions, "learner", arguments, lambda _: None)
    options.check()
    return options


@pytest.mark.parametrize(
    ("flag", "scheme"), [("--listen", "tcp/"), ("--connect", "tls/"), ("--http", ""), ("--web", "")]
)
def test_an_address_that_is_none_is_refused_before_anything_is_loaded(
    flag: str, scheme: str
) -> None:
    with pytest.raises(InputError, match="localhost:99999 has no valid port: choose one from"):
        learner(flag, f"{scheme}localhost:99999")


@pytest.mark.parametrize(
    "mode",
    [
        [],
        ["--sync"],
        ["--wait-action"],
        ["--no-sync"],
        ["--no-sync", "--wait-action"],
        ["--no-sync", "--speed", "2.5", "--wait-action"],
    ],
)
def test_local_actors_get_the_mode_that_was_asked_for(mode: list[str]) -> None:
    options = learner("--local", *mode)
    actor = parse(ActorOptions, "actors", options.clock.flags())
    actor.check()
    assert actor.clock == ClockConfig(
        sync="--no-sync" not in mode,
        wait_action="--wait-action" in mode,
        speed=2.5 if "2.5" in mode else 1.0,
    )
    # And the learner itself, when it is told to go on.
    again = learner("--local", *options.clock.flags())
    assert again.clock.flags() == options.clock.flags()


DQN = ("--learning.algorithm", "dqn")
QR = ("--learning.algorithm", "qr_dqn")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--local", "--speed", "2"], "--speed is for --no-sync"),
        (["--local", "--no-sync", "--speed", "0"], "above 0"),
        (["--local", "--no-sync", "--envs", "2"], "an actor for each environment: omit --envs"),
        (["--gate-minutes", "0"], r"--gate-minutes is 0.0: choose more than 0\."),
        (["--gate-minutes", "inf"], "--gate-minutes is inf: choose a finite number"),
        (["--stall-minutes", "0"], r"--stall-minutes is 0.0: choose more than 0\."),
        (["--stall-minutes", "nan"], "--stall-minutes is nan: choose more than 0"),
        (["--local", "--actors", "0"], r"--actors is 0: choose 1 or more\."),
        (["--local", "--envs", "0"], r"--envs is 0: choose 1 or more\."),
        (["--evaluators", "-1"], r"--evaluators is -1: choose 0 or more\."),
        (["--threads", "-1"], r"--threads is -1: choose 0 or more\."),
        (["--threads", "10000000000000"], r"--threads is 1.*0: choose at most 1024\."),
        (["--local", "--actors", "10000000000"], r"--actors is 10000000000: choose at most 4096"),
        (["--evaluators", "10000000000"], r"--evaluators is 10000000000: choose at most 4096\."),
        (["--local", "--envs", "257"], r"--envs is 257: choose at most 256\."),
        (["--replay.priority-exponent=90"], r"priority-exponent is 90.0: choose at most 1\."),
        (["--replay.importance-exponent=90"], r"importance-exponent is 90.0: choose at most 1\."),
        (
            [*DQN, "--learning.quantiles", "9"],
            "--learning.quantiles means nothing to the algorithm dqn",
        ),
        (["--replay.priority-exponent=0.5"], "exponent means nothing to the sampler uniform: omit"),
        (["--replay.importance-exponent=1"], "exponent means nothing to the sampler uniform: omit"),
        (
            ["--learning.rmsprop-decay=0.9"],
            "means nothing to Adam: omit it, or choose --learning.o",
        ),
        (
            ["--learning.annealing-steps=0", "--learning.final-learning-rate=1e-6"],
            "--learning.final-learning-rate means nothing without --learning.annealing-steps",
        ),
        (
            ["--learning.target", "dqn", "--preset", "paper", "--learning.early-choice"],
            "--learning.early-choice means nothing without --learning.target double: omit it, or",
        ),
        ([*QR, "--learning.loss", "mse"], "--learning.loss means nothing to the algorithm qr_dqn"),
        ([*QR, "--learning.loss-mean-over=outputs"], "--learning.loss-mean-over means nothing to"),
        (
            ["--learning.curriculum-steps", "9"],
            "there is no range that it could widen: give one of --randomise",
        ),
        (["--learning.curriculum-score", "9"], "judges a curriculum: give its --learning.curric"),
        (["--no-sync"], "--no-sync is for --local"),
        (
            ["--actors", "2"],
            "--actors is for --local: omit it, and start actors by `ale",
        ),
        (["--envs", "2"], "--envs is for --local"),
        (["--evaluators", "0"], "--evaluators is for --local"),
        (
            ["--connect", "tcp/h:1", "--listen", "tcp/0.0.0.0:1"],
            "--listen means nothing beside --connect: omit one of them",
        ),
        (
            ["--local", "--connect", "tcp/h:1", "--actor-quota", "9"],
            "--actor-quota is for the replay at --connect: give it to that",
        ),
        (["--patience", "inf"], "--patience is for a replay at --connect: omit it"),
        (["--wait-action"], "--wait-action is for --local"),
        (["--local", "--env", "ale", "--no-sync"], "--no-sync is for a robot"),
        (["--local", "--env", "ale", "--wait-action"], "--wait-action is for a robot"),
    ],
)
def test_what_would_have_no_effect_is_refused(arguments: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        learner(*arguments)


def test_what_has_an_effect_is_accepted() -> None:
    learner("--replay.sampler=prioritised", "--replay.priority-exponent=0.5")
    learner("--learning.optimizer=rmsprop", "--learning.rmsprop-decay=0.9")
    learner("--learning.annealing-steps=9", "--learning.final-learning-rate=1e-6")
    learner("--learning.annealing-steps=0")
    learner("--preset", "fast", "--learning.target", "dqn")  # whose early choice nobody gave
    learner("--local", "--actors=2", "--envs=2", "--evaluators=0", "--actor-quota=9")
    learner("--connect", "tcp/h:1", "--patience=inf", "--local", "--actors=2")
    learner("--listen", "tcp/0.0.0.0:1", "--actors=1")  # as usual


def test_what_comes_from_the_initial_network_was_not_given(tmp_path: Path) -> None:
    """The network is refused later, in words about its shape."""
    trained = learner("--env", "ale", *QR, "--learning.quantiles", "9")
    file = tmp_path / "nine.safetensors"
    here = RunFolder(tmp_path, "here")
    file.write_bytes(encode_network_file(first_network(trained, here), trained.config))
    made = learner("--env", "ale", "--initial", str(file), *DQN)
    assert (made.config.learning.algorithm, made.config.learning.quantiles) == ("dqn", 9)


def test_an_empty_name_is_not_that_of_the_usual_run() -> None:
    """As of `--run "$NAME"` in a script without a NAME."""
    assert run_name(learner()) == "robot-pong-robot"
    with pytest.raises(InputError, match="run '' cannot be used"):
        RunFolder(Path(), run_name(learner("--run", "")))


def test_presets_and_runs_may_have_what_the_algorithm_ignores() -> None:
    paper = learner("--preset", "paper", *QR, "--learning.quantiles", "9").config.learning
    assert (paper.loss, paper.loss_mean_over, paper.quantiles) == ("mse", "outputs", 9)
    fast = PRESETS["fast"]
    begun = replace(
        fast, learning=replace(fast.learning, algorithm="dqn", quantiles=9)
    )  # before it was refused
    parse_run(LearnerOptions, "learner", ["--resume", "--run", "r"], lambda _: begun).check()
    assert learner("--stall-minutes", "inf").stall_minutes == float("inf")


def test_records_tell_local_modes_clock_and_nobody_elses() -> None:
    options = learner("--local", "--no-sync", "--speed", "2", "--wait-action")
    assert clock_figures(options) == {"run/sync": False, "run/wait_action": True, "run/speed": 2.0}
    assert clock_figures(learner()) == {}


@pytest.mark.parametrize("flag", ["--no-sync", "--wait-action"])
def test_an_actor_does_not_join_a_run_without_robots_in_another_time(flag: str) -> None:
    options = parse(ActorOptions, "actors", [flag])
    options.check()
    options.check_against(PRESETS["robot"])
    with pytest.raises(InputError, match=flag):
        options.check_against(PRESETS["fast"])


def test_an_actor_joins_only_the_run_that_is_asked_for() -> None:
    config = PRESETS["robot"]
    for robot in ("nao", "hand.npz", f"hand.npz#sha256={'0' * 64}"):
        run = replace(config, play=replace(config.play, robot=robot))
        for asked in ("nao", "hand.npz"):
            options = parse(ActorOptions, "actors", ["--robot", asked])
            if robot.startswith(asked):
                options.check_against(run)
            else:
                with pytest.raises(InputError, match=f"plays .*, not {asked}: omit --robot"):
                    options.check_against(run)


def test_an_actor_does_not_join_a_run_without_the_robot_or_the_game_that_is_asked_for() -> None:
    robot = parse(ActorOptions, "actors", ["--robot", "nao"])
    with pytest.raises(InputError, match=r"plays pong \(ale\), without a robot, not nao: omit"):
        robot.check_against(PRESETS["fast"])
    hands = replace(PRESETS["fast"], play=replace(PRESETS["fast"].play, robot="hand.npz"))
    parse(ActorOptions, "actors", ["--robot", "./hand.npz"]).check_against(hands)
    with pytest.raises(InputError, match=r"plays hand\.npz, not nao: omit --robot"):
        robot.check_against(hands)


def evaluation(*arguments: str) -> RunConfig:
    command = parse_played(Evaluation, "learner.evaluation", arguments)
    command.check()
    return command.config()


def test_settings_are_the_runs_that_is_gone_on_with_or_evaluated(tmp_path: Path) -> None:
    trained = replace(PRESETS["paper"], game="breakout", seed=7)
    folder = RunFolder(tmp_path, "r")
    folder.claim("learner", trained, resume=False)
    folder.checkpoint.write_bytes(save({}))

    def found(*arguments: str) -> object:
        return parse_run(LearnerOptions, "learner", arguments, stored_config).config

    here = ("--runs", str(tmp_path), "--run", "r")
    assert found(*here) == PRESETS["robot"]
    assert found(*here, "--resume") == trained
    network = str(folder.checkpoint)
    assert evaluation(network) == trained
    delayed = replace(trained, env="robot", play=replace(trained.play, actuation_latency=2))
    assert evaluation(network, "--env", "robot", "--play.actuation-latency", "2") == delayed


def test_an_evaluation_draws_only_what_it_is_told_to(tmp_path: Path) -> None:
    preset = PRESETS["robot"]
    trained = replace(preset, seed=7, randomise=replace(all_ranges("robot"), actuation_latency=6))
    trained = replace(trained, learning=replace(trained.learning, curriculum_steps=9))
    folder = RunFolder(tmp_path, "r")
    folder.claim("learner", trained, resume=False)
    folder.checkpoint.write_bytes(save({}))

    def found(*arguments: str) -> RunConfig:
        options = parse_run(LearnerOptions, "learner", arguments, stored_config)
        options.check()
        return options.config

    network = str(folder.checkpoint)  # a curriculum has no ranges to grow here, and needs none
    assert evaluation(network) == replace(trained, randomise=RandomiseConfig())
    assert evaluation(network, "--randomise.gamma", "1.5").randomise == RandomiseConfig(gamma=1.5)
    drawn = evaluation(network, "--randomise.all", "--randomise.gamma", "1.2").randomise
    assert drawn == replace(all_ranges("robot"), gamma=1.2)
    for arguments in ((network, "--env", "ale"), ("ale_pong",)):
        drawn = evaluation(*arguments, "--randomise.all").randomise
        assert drawn == all_ranges("ale") != all_ranges("robot")
    assert found("--runs", str(tmp_path), "--run", "r", "--resume") == trained


def test_a_run_that_goes_on_says_first_what_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, flags = RunFolder(tmp_path, "r"), ("--runs", str(tmp_path), "--run", "r")
    config = learner(*flags).config
    folder.claim("learner", config, resume=False)
    assert opening(learner(*flags, "--resume")) == LOADING  # it has nothing yet
    folder.checkpoint.touch()
    assert opening(learner(*flags)) == LOADING
    folder.replay.mkdir()
    (folder.replay / "frames.bin").write_bytes(bytes(20_000_000))
    begins = "going on with run r: opening its checkpoint and "
    told = opening(learner(*flags, "--resume"))
    assert told == f"{begins}its replay (0.02 GB) ..."
    elsewhere = opening(learner(*flags, "--resume", "--connect", "tcp/h:1"))
    assert elsewhere == f"{begins}the replay at tcp/h:1 ..."

    # Before PyTorch is loaded.
    monkeypatch.setitem(sys.modules, "learner.process", None)
    monkeypatch.setattr(sys, "argv", ["learner", *flags, "--resume"])
    with pytest.raises(ImportError):
        main()
    assert capsys.readouterr().out == f"{told}\n"


def test_a_program_says_that_it_starts_once_its_flags_are_known_to_be_right(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for module in ("process", "evaluation.offline"):  # where PyTorch would be loaded
        monkeypatch.setitem(sys.modules, f"learner.{module}", None)

    def said(raised: type[Exception], *arguments: str) -> tuple[str, str]:
        monkeypatch.setattr(sys, "argv", ["learner", *arguments])
        with pytest.raises(raised):
            main()
        return capsys.readouterr()

    evaluation = ("--evaluate", "robot_pong")
    assert said(InputError, "--steps", "5") == said(InputError, "--game", "pomg") == ("", "")
    assert said(InputError, *evaluation, "--games", "0") == ("", "")
    assert said(InputError, "--run", "nobodys", "--resume") == ("", "")
    assert said(ImportError, "--steps", "500000") == (f"{LOADING}\n", "")
    # Standard output has only the results.
    assert said(ImportError, *evaluation) == ("", f"{LOADING}\n")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--games", "5"), r"--games is for an evaluation, `ale-robot evaluate`: omit it\."),
        (("--headline",), r"--headline is for an evaluation"),
        (("--processes=0",), r"--processes is for an evaluation"),
        (("--json", "x/y.json"), r"--json is for an evaluation"),
        (("--test-steps", "6000"), r"--test-steps is .*: give --protocol\.test-steps\."),
        (("--test_steps", "0"), r"--test-steps is .*: give --protocol\.test-steps\."),
        (("--epsilon", "0.1"), r"give --exploration\.end or --protocol\.test-epsilon\."),
        (("--evaluate",), r"FILE is missing \(Network to evaluate,"),
        (("--evaluate", "robot_pong", "--steps", "5"), r"training: give --games or --test-steps\."),
        (("--evaluate", "robot_pong", "--envs", "5"), r"training: give --processes\."),
        (("--evaluate=robot_pong", "--run", "r"), r"training: name the network alone, as in `ale"),
        (("--evaluate", "robot_pong", "--learning.n-step", "5"), r"no flag --learning\.n-step"),
        (("--evaluate", "ale_pong", "--no-sync"), r"--no-sync is for a robot"),
        (("--local", "--evaluate"), r"FILE is missing \(Network to evaluate,"),
        (("--local", "--status", "r"), r"^r is not a run: name one"),
        (
            ("--local", "--evaluate", "ale_pong", "--game", "breakout"),
            r"4 actions: give --game pong",
        ),
    ],
)
def test_flags_of_another_program_are_told(
    arguments: tuple[str, ...], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["learner", *arguments])
    with pytest.raises(InputError, match=words):
        main()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("place", ["runs", "runs/r"])
def test_a_folder_that_cannot_be_made_is_told_before_pytorch_is_loaded(
    tmp_path: Path,
    place: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, "learner.process", None)
    (tmp_path / place).parent.mkdir(exist_ok=True)
    (tmp_path / place).touch()
    monkeypatch.setattr(sys, "argv", ["learner", "--run", "r", "--runs", str(tmp_path / "runs")])
    with pytest.raises(InputError, match=r"runs/r cannot be written \(Not a directory\): name an"):
        main()
    assert capsys.readouterr().out == ""


def test_a_disk_that_nobody_may_write_to_is_told_and_left_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object, **where: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(where["dir"]))

    flags = ("--runs", str(tmp_path / "a" / "runs"), "--run", "r")
    learner(*flags).check_here()
    monkeypatch.setattr("tempfile.TemporaryFile", refused)
    with pytest.raises(InputError, match=r"runs/r cannot be written \(Read-only") as error:
        learner(*flags).check_here()
    assert error.value.exit_code == NO_ROOM
    assert not list(tmp_path.iterdir())


def test_an_actor_without_a_certificate_is_told_before_a_run_is_made(tmp_path: Path) -> None:
    folder = certify(tmp_path / "certificates")
    certify(folder, "--actors", "actor-1", "evaluator-1")
    place = ("--listen", "tls/127.0.0.1:7447", "--certificates", str(folder))
    flags = ("--local", "--runs", str(tmp_path / "runs"), "--run", "r", *place)
    learner(*flags).check_here()
    for more, missing in (("--actors=2", "actor-2"), ("--evaluators=2", "evaluator-2")):
        with pytest.raises(InputError, match=rf"actors.txt does not list {missing}: make its cert"):
            learner(*flags, more).check_here()
    learner(*(flag for flag in flags if flag != "--local")).check_here()
    assert not (tmp_path / "runs").exists()


def test_what_the_runs_folder_refuses_is_a_line_of_json_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    roles: list[str] = []
    monkeypatch.setattr("learner.__main__.say_json", roles.append)
    monkeypatch.setattr(sys, "argv", ["learner", "--run", "nobodys", "--resume", "--log-json"])
    with pytest.raises(InputError, match="there is no run"):
        main()
    assert roles == ["learner"]


def test_a_run_is_refused_at_once_if_it_has_a_replay_and_no_checkpoint(tmp_path: Path) -> None:
    flags = ("--runs", str(tmp_path), "--run", "r")
    RunFolder(tmp_path, "r").replay.mkdir(parents=True)
    with pytest.raises(InputError, match="already holds a run: go on with it by --resume"):
        learner(*flags).check_here()
    learner(*flags, "--connect", "tcp/h:1").check_here()  # the replay is another process's


@pytest.mark.parametrize(
    ("arguments", "done", "again"),
    [
        ("", False, "--run r --resume"),
        ("--local --no-sync --actors 4", False, "--local --no-sync --actors 4 --run r --resume"),
        ("--runs D --run=r --steps 9", False, "--runs D --run=r --steps 9 --resume"),
        ("--run r --steps 9 --local", True, "--run r --local --resume"),
        ("--steps=9 --run r --resume", True, "--run r --resume"),
        ("--run r --initial a.safetensors --force", False, "--run r --resume"),
        ("--initial=a.safetensors --connect tcp/h:1", False, "--connect tcp/h:1 --run r --resume"),
        ("--local --no-local --run r", False, "--no-local --run r --resume"),
        ("--config a.toml --run r", True, "--config a.toml --run r --resume --steps None"),
        ("--config a.toml --run r --steps 9", False, "--config a.toml --run r --steps 9 --resume"),
        ("--run r --learner 'a b'", False, "--run r --learner 'a b' --resume"),
    ],
)
def test_the_command_that_goes_on_is_told(arguments: str, done: bool, again: str) -> None:
    told = resume_command(shlex.split(arguments), "r", done=done)
    assert told == f"python -m learner {again}"


@pytest.mark.parametrize(
    ("arguments", "done", "force", "told"),
    [
        ("--local --run r --actors 1", False, False, "make train NAME='r'"),
        ("--local --run r --resume --force", False, True, "make train NAME='r'"),
        # It would give flags that do not continue the run.
        ("--local --run r --steps 9", True, False, ".venv/bin/ale-robot train --run r --resume"),
        ("--local --run r --initial a", False, False, ".venv/bin/ale-robot train --run r --resume"),
        ("--local --run r", False, True, ".venv/bin/ale-robot train --run r --resume --force"),
    ],
)
def test_a_run_that_make_started_goes_on_by_make(
    arguments: str, done: bool, force: bool, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ALE_ROBOT_AGAIN", "make train NAME='r'")
    monkeypatch.setattr(sys, "argv", ["ale-robot train"])
    assert resume_command(arguments.split(), "r", done=done, force=force) == told


def test_a_run_that_is_a_part_of_an_experiment_goes_on_by_that(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ALE_ROBOT_EXPERIMENT", "python -m benchmarks.lab.race")
    for done in (True, False):
        told = resume_command(["--local", "--steps", "9"], "r", done=done)
        assert told == "python -m benchmarks.lab.race"


def test_a_run_that_ended_before_its_first_checkpoint_has_the_network_it_was_given(
    tmp_path: Path,
) -> None:
    here = ("--runs", str(tmp_path), "--run", "r", "--env", "ale", "--seed", "3")
    folder = RunFolder(tmp_path, "r")
    fresh = first_network(learner(*here), folder)
    other = first_network(learner(*here[:-1], "4"), folder)
    folder.path.mkdir()
    folder.initial.write_bytes(encode_weights(other))

    def hidden(*arguments: str) -> torch.Tensor:
        return first_network(learner(*here, *arguments), folder).hidden.weight

    assert torch.equal(hidden(), fresh.hidden.weight)
    assert torch.equal(hidden("--resume"), other.hidden.weight)
    assert torch.equal(hidden("--resume", "--initial", str(folder.initial)), other.hidden.weight)
    folder.checkpoint.touch()  # from which all weights will be taken
    assert torch.equal(hidden("--resume", "--initial", str(folder.initial)), other.hidden.weight)
    another = tmp_path / "another.safetensors"
    another.write_bytes(encode_weights(fresh))
    with pytest.raises(InputError, match=r"did not begin with .*another.safetensors: omit"):
        hidden("--resume", "--initial", str(another))
    folder.initial.unlink()
    with pytest.raises(InputError, match=r"did not begin with .*another.safetensors: omit"):
        hidden("--resume", "--initial", str(another))
    assert torch.equal(hidden("--resume"), fresh.hidden.weight)
    folder.checkpoint.unlink()  # it was killed before it kept what it was given
    assert torch.equal(hidden("--resume", "--initial", str(another)), fresh.hidden.weight)


def test_a_restart_takes_what_the_run_has_kept_of_the_network_it_was_given(tmp_path: Path) -> None:
    given = tmp_path / "given.safetensors"
    given.write_bytes(save({}))
    options = learner("--runs", str(tmp_path), "--run", "r", "--initial", str(given))
    folder = RunFolder(tmp_path, "r")
    assert going_on(options) == options
    folder.claim("learner", options.config, resume=False)
    assert going_on(options) == replace(options, resume=True)
    folder.initial.touch()
    assert going_on(options) == replace(options, resume=True, initial=None)


@pytest.mark.parametrize(
    ("flag", "value", "package", "extra"),
    [
        ("--demonstrations", "recording", "pyarrow", "record"),
        ("--http", "127.0.0.1:9100", "uvicorn", "ops"),
        ("--web", "127.0.0.1:0", "starlette", "web"),
        ("--track", "wandb", "wandb", "wandb"),
        ("--track", "mlflow", "mlflow", "mlflow"),
        ("--track", "trackio", "trackio", "trackio"),
    ],
)
def test_a_package_that_is_not_installed_is_told_before_pytorch_is_loaded(
    monkeypatch: pytest.MonkeyPatch, flag: str, value: str, package: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setitem(sys.modules, "learner.process", None)
    monkeypatch.setattr(sys, "argv", ["learner", flag, value])
    with pytest.raises(InputError, match=rf"{flag}.* {package}, .*'ale-robot\[{extra}\]'"):
        main()
    learner(flag, value)  # where a run is launched from, nothing needs it


def test_a_run_that_has_its_demonstrations_goes_on_without_their_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    options = learner("--runs", str(tmp_path), "--run", "r", "--demonstrations", "recording")
    RunFolder(tmp_path, "r").claim("learner", options.config, resume=False)
    replace(options, resume=True).check_here()


@pytest.mark.parametrize(
    ("trained", "flags", "advice"),
    [
        (QR, DQN, "give --learning.algorithm qr_dqn"),
        (("--play.vector",), (), "give --play.vector"),
        (
            ("--learning.no-center-pixels",),
            ("--learning.center-pixels",),
            "give --learning.no-center-pixels",
        ),
    ],
)
def test_a_network_that_does_not_fit_says_what_it_is_for(
    tmp_path: Path, trained: tuple[str, ...], flags: tuple[str, ...], advice: str
) -> None:
    file, here = tmp_path / "p.safetensors", RunFolder(tmp_path, "here")
    made = learner("--env", "ale", *trained)
    file.write_bytes(encode_network_file(first_network(made, here), made.config))
    asked = learner("--env", "ale", "--initial", str(file), *flags)
    with pytest.raises(InputError, match=rf"{file}, which plays pong .*: {advice}"):
        first_network(asked, here)


@pytest.mark.parametrize(
    ("flags", "command"),
    [
        ((), "ale-robot join"),
        (("--listen", "tcp/0.0.0.0:1"), "ale-robot join --connect tcp/127.0.0.1:1"),
        (
            ("--connect", "tls/h:1", "--certificates", "a b"),
            "ale-robot join --connect tls/h:1 --certificates 'a b'",
        ),
        (
            ("--connect", "tls/h:1", "--certificates", "learners"),
            "ale-robot join --connect tls/h:1 --certificates FOLDER",
        ),
    ],
)
def test_the_command_that_starts_an_actor_is_told(
    flags: tuple[str, ...], command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder, file in (("a b", "actor.tester.pem"), ("learners", "learner.pem")):
        Path(folder).mkdir()
        Path(folder, file).touch()
    assert join_command(learner(*flags)) == command

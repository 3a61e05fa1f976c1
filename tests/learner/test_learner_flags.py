"""How time passes: what the learner's command line takes, refuses, and tells its actors."""

import shlex
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from actors.__main__ import ActorOptions
from common.errors import InputError
from common.process.command_line import parse, parse_run
from common.protocol.weights import encode_weights
from common.run.clock import ClockConfig
from common.run.folder import RunFolder
from common.run.presets import PRESETS
from learner.__main__ import first_network
from learner.options import LearnerOptions, clock_figures, resume_command, stored_config


def learner(*arguments: str) -> LearnerOptions:
    options = parse_run(LearnerOptions, "learner", arguments, lambda _: None)
    options.check()
    return options


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


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--local", "--speed", "2"], "--speed is for --no-sync"),
        (["--local", "--no-sync", "--speed", "0"], "above 0"),
        (["--gate-minutes", "0"], "above 0, or --force"),
        (["--no-sync"], "--no-sync is for --local"),
        (["--wait-action"], "--wait-action is for --local"),
        (["--local", "--env", "ale", "--no-sync"], "--no-sync is for a robot"),
        (["--local", "--env", "ale", "--wait-action"], "--wait-action is for a robot"),
    ],
)
def test_what_would_have_no_effect_is_refused(arguments: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        learner(*arguments)


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


def test_settings_are_the_runs_that_is_gone_on_with_or_evaluated(tmp_path: Path) -> None:
    trained = replace(PRESETS["paper"], game="breakout", seed=7)
    folder = RunFolder(tmp_path, "r")
    folder.claim("learner", trained, begun=folder.checkpoint, resume=False)
    folder.checkpoint.touch()

    def found(*arguments: str) -> object:
        return parse_run(LearnerOptions, "learner", arguments, stored_config).config

    here = ("--runs", str(tmp_path), "--run", "r")
    assert found(*here) == PRESETS["robot"]
    assert found(*here, "--resume") == trained
    network = ("--evaluate", str(folder.checkpoint))
    assert found(*network) == trained
    delayed = replace(trained, env="robot", play=replace(trained.play, command_latency=2))
    assert found(*network, "--env", "robot", "--play.command-latency", "2") == delayed


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
        ("--run r --learner 'a b'", False, "--run r --learner 'a b' --resume"),
    ],
)
def test_the_command_that_goes_on_is_told(arguments: str, done: bool, again: str) -> None:
    told = resume_command(shlex.split(arguments), "r", done=done)
    assert told == f"python -m learner {again}"


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
    folder.checkpoint.touch()  # from which all weights will be taken
    assert torch.equal(hidden("--resume"), fresh.hidden.weight)

"""Environments, robots and algorithms found by name, also those of installed packages."""

import subprocess
import sys
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks.entry_point import add_entry_point
from common.errors import InputError
from common.network import QNetwork, build_network, count_actions_of
from common.registry import (
    ALGORITHMS,
    ENVIRONMENTS,
    ROBOTS,
    AlgorithmKind,
    Environment,
    Registry,
    RobotKind,
)
from common.run.rules import check_config
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from tests.paths import ROOT


def test_this_projects_are_known() -> None:
    assert ENVIRONMENTS.names == ["ale", "robot"]
    assert ROBOTS.names == ["FILE.npz", "nao", "robotroller"]
    assert ALGORITHMS.names == ["dqn", "qr_dqn"]
    assert not ENVIRONMENTS.find("ale").robot
    assert ENVIRONMENTS.find("robot").robot


@pytest.mark.parametrize(
    ("config", "sentence"),
    [
        (RunConfig(env="real"), "there is no environment 'real': choose one of ale, robot, or"),
        (
            RunConfig(env="balance"),
            r"no environment .*: did you mean ale\? Otherwise install the package that has it",
        ),
        (
            replace(RunConfig(), play=replace(RunConfig().play, robot="atlas")),
            "there is no robot 'atlas': choose one of FILE.npz, nao, robotroller, or install",
        ),
        (
            replace(RunConfig(), learning=replace(RunConfig().learning, algorithm="sarsa")),
            "there is no algorithm 'sarsa': choose one of dqn, qr_dqn, or install",
        ),
    ],
)
def test_a_run_in_what_nobody_has_is_refused(config: RunConfig, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        check_config(config)


def test_the_network_is_of_the_kind_that_the_algorithms_entry_names(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Other(QNetwork):
        pass

    entry = AlgorithmKind("c51", "nowhere:c51", network=Other, atoms=lambda learning: 51)
    monkeypatch.setitem(ALGORITHMS._entries, "c51", entry)
    config = replace(PRESETS["fast"], learning=replace(PRESETS["fast"].learning, algorithm="c51"))
    network = build_network(config, 6)
    assert type(network) is Other
    assert network.actions.out_features == 6 * 51
    assert count_actions_of(config, network.state_dict()) == 6
    # Nobody's network is built in the place of one that is not known.
    unknown = replace(config, learning=replace(config.learning, algorithm="sarsa"))
    with pytest.raises(InputError, match="no algorithm 'sarsa'"):
        build_network(unknown, 6)


def test_an_emulator_alone_needs_no_robot() -> None:
    play = replace(PRESETS["fast"].play, robot="atlas")
    check_config(replace(PRESETS["fast"], play=play))


def test_an_entry_called_file_stands_for_every_file_with_its_suffix() -> None:
    registry = Registry("robot", RobotKind("FILE.npz", SimpleNamespace, joints=8))
    for name in ("hand.npz", "a/b.c/hand.npz", f"hand.npz#sha256={'0' * 64}", "FILE.npz"):
        assert registry.find(name).joints == 8
    assert registry.make("hand.npz", arm=1) == SimpleNamespace(arm=1)
    registry.add(RobotKind("own.npz", SimpleNamespace, joints=2))
    assert registry.find("own.npz").joints == 2
    for name in ("npz", "hand.npy", "hand", ""):
        with pytest.raises(InputError, match=r"no robot '.*': (choose one of|did you mean)"):
            registry.find(name)


def test_an_entry_that_several_packages_have_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [EntryPoint("toy", value, "ale_robot.robots") for value in ("b:TOY", "a:TOY", "a:TOY")]
    monkeypatch.setattr("common.registry.entry_points", lambda **_: points)
    told = r"^several installed packages have the robot 'toy' \(a:TOY, b:TOY\): uninstall all but"
    with pytest.raises(InputError, match=told):
        Registry[RobotKind]("robot").find("toy")


def test_an_entry_is_added_made_and_replaced() -> None:
    registry = Registry[RobotKind]("robot")
    with pytest.raises(InputError):
        registry.find("toy")
    registry.add(RobotKind("toy", SimpleNamespace, joints=3))
    assert registry.find("toy").joints == 3
    assert registry.make("toy", arm=1) == SimpleNamespace(arm=1)
    registry.add(RobotKind("toy", "types:SimpleNamespace", joints=4))
    assert registry.names == ["toy"]
    assert registry.find("toy").joints == 4
    assert registry.make("toy", arm=2) == SimpleNamespace(arm=2)


def test_a_factory_of_another_package_fails_in_one_sentence() -> None:
    registry = Registry("robot", RobotKind("ours", lambda: 1 / 0, joints=1))
    for name, factory in (("theirs", lambda: 1 / 0), ("typo", "types:SimpelNamespace")):
        registry.add(RobotKind(name, factory, joints=1))
    with pytest.raises(ZeroDivisionError):  # its traceback is for us
        registry.make("ours")
    place = r"ZeroDivisionError\('division by zero'\), .*/test_registry\.py:\d+"
    with pytest.raises(
        InputError,
        match=rf"^the factory of the robot 'theirs' fails \({place}\): mend its package\.$",
    ):
        registry.make("theirs")
    with pytest.raises(InputError, match=r"has no attribute 'SimpelNamespace'"):
        registry.make("typo")


@pytest.mark.parametrize("error", [InputError("choose one leg."), FileNotFoundError("legs.toml")])
def test_what_a_factory_says_itself_is_told_as_it_is(error: Exception) -> None:
    def make() -> None:
        raise error

    registry = Registry[RobotKind]("robot")
    registry.add(RobotKind("theirs", make, joints=1))
    with pytest.raises(type(error)) as told:
        registry.make("theirs")
    assert told.value is error


def test_an_installed_package_brings_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my_catch.py").write_text(
        "from common.registry import Environment\n"
        "CATCH = Environment('catch', 'my_catch:make', lambda config: 3)\n"
    )
    add_entry_point(tmp_path, "my-catch", "environment", "catch", "my_catch:CATCH")
    monkeypatch.syspath_prepend(str(tmp_path))
    registry = Registry[Environment]("environment")
    assert registry.names == ["catch"]
    assert "my_catch" not in sys.modules
    assert registry.find("catch").actions(RunConfig()) == 3
    # What is added in this process comes before what is installed.
    registry.add(Environment("catch", "my_catch:make", lambda config: 4))
    assert registry.find("catch").actions(RunConfig()) == 4
    monkeypatch.delitem(sys.modules, "my_catch")


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (
            "import nowhere_at_all\n",
            r"be loaded \(ModuleNotFoundError\(.*\)\): mend the package, or",
        ),
        ("BAD = 1 / 0\n", r"cannot be loaded \(ZeroDivisionError\(.*\)\): mend"),
        ("", r"cannot be loaded \(AttributeError\(.*\)\): mend"),
        ("BAD = 5\n", r"is not an entry of that name: mend the package"),
        (
            "from common.registry import Environment\nBAD = Environment('good', 'm:f', len)\n",
            r"is not an entry of that name: mend the package",
        ),
    ],
)
def test_a_package_that_cannot_be_loaded_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, words: str
) -> None:
    (tmp_path / "my_bad.py").write_text(code)
    add_entry_point(tmp_path, "my-bad", "environment", "bad", "my_bad:BAD")
    monkeypatch.syspath_prepend(str(tmp_path))
    registry = Registry[Environment]("environment")
    with pytest.raises(InputError, match=rf"^the environment 'bad' .* my_bad:BAD, .*{words}"):
        registry.find("bad")
    with pytest.raises(InputError):  # the second time too
        registry.find("bad")
    sys.modules.pop("my_bad", None)


@pytest.mark.parametrize("package", ["replay", "learner"])
def test_replay_and_learner_load_neither_actors_nor_an_emulator(package: str) -> None:
    program = (
        f"import sys, {package}.__main__\n"
        "from common.settings.config import RunConfig\n"
        "assert RunConfig().action_count == 18\n"
        "print(*{name.split('.')[0] for name in sys.modules})"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    assert not {"actors", "viewer", "ale_py", "pybullet", "gymnasium"} & set(loaded)
    assert package in loaded

"""`python -m viewer check` and `play`: figures, pictures, films, and what is refused."""

import re
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from queue import Queue
from typing import Any

import cv2
import numpy as np
import pytest

import viewer.check
from actors.envs.ale import AtariEnv
from actors.envs.eye import Eye
from actors.robots.latency import Change
from actors.robots.nao.assembly import write_nao
from actors.vision.screen_detector import ScreenDetector
from common.command_line.parser import parse
from common.command_line.played import Played
from common.errors import InputError
from common.exit_codes import INTERRUPTED
from common.network import build_network
from common.pinned_file import pin
from common.process.log_lines import LOADING
from common.protocol.weights import encode_weights
from common.registry import ENVIRONMENTS, ROBOTS, Environment, RobotKind
from common.run.network_file import encode_network_file
from common.settings.clock import ClockConfig
from common.settings.conditions import CameraConfig, PlayConfig
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from common.settings.ranges import RandomiseConfig
from common.settings.stored_config import to_json
from tests.actors.robots.latency_model.models import delay, saved
from tests.extending.test_environment import LAMPS
from tests.extending.whole_run import added
from tests.patience import PATIENCE
from tests.viewer.commands import command, parsed
from tests.viewer.rrd import recorded
from viewer.__main__ import COMMANDS, main
from viewer.check import CORNERS_IN_PLACE, Check
from viewer.film import Film
from viewer.human import Human
from viewer.player import ShownPolicy, shown_env
from viewer.show import Play
from viewer.watch import Watch

SHORT = replace(
    PRESETS["robot"], play=PlayConfig(random_starts=0, max_game_frames=16, minimal_actions=True)
)
"""Games of 4 agent steps."""


def in_run(folder: Path, config: RunConfig, actions: int) -> Path:
    """Weights where a run leaves them."""
    snapshots = folder / "runs" / "r" / "snapshots"
    snapshots.mkdir(parents=True)
    (folder / "runs" / "r" / "config.json").write_text(to_json(config))
    path = snapshots / "best.safetensors"
    path.write_bytes(encode_weights(build_network(config, actions)))
    return path


def size_of(picture: Path) -> tuple[int, int, int]:
    read = cv2.imread(str(picture))
    assert read is not None
    high, wide, colours = read.shape
    return high, wide, colours


def hide_pytorch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets PyTorch be missing."""
    parse(Check, "viewer", [])  # tyro's first parse would import what is hidden
    monkeypatch.setitem(sys.modules, "torch", None)


def test_commands(tmp_path: Path) -> None:
    weights = tmp_path / "w"
    weights.touch()
    found = parse(COMMANDS["play"], "viewer", [str(weights), "--viewer", "rerun", "--no-sync"])
    assert found == Play(weights=weights, viewer="rerun", clock=ClockConfig(sync=False))
    assert parse(COMMANDS["check"], "viewer", ["-o", "p.png"]) == Check(output=Path("p.png"))


def test_a_command_says_at_a_terminal_that_it_loads_pytorch_if_its_flags_are_right(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    hide_pytorch(monkeypatch)
    said = []
    for terminal in (True, False):
        monkeypatch.setattr(sys.stdout, "isatty", lambda terminal=terminal: terminal)
        for flags, raised in ((["--seed", "1"], ImportError), (["--nao-urdf", "x"], InputError)):
            monkeypatch.setattr(sys, "argv", ["viewer", "play", *flags])
            with pytest.raises(raised):
                main()
            said.append(capsys.readouterr().out)
    assert said == [f"{LOADING}\n", "", "", ""]


@pytest.mark.parametrize("kind", [Watch, Play, Film])
def test_a_network_needs_no_flag(kind: Any, tmp_path: Path) -> None:
    weights = tmp_path / "w"
    weights.touch()
    named = {"shown" if kind is Film else "weights": weights}
    for arguments in (["--seed", "2", str(weights)], [str(weights), "--seed", "2"]):
        assert parse(kind, "viewer", arguments) == kind(seed=2, **named)
    assert parse(kind, "viewer", ["--seed", "2"]) == kind(seed=2)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["record", "--weights", "w", "-o", "r"], "^--weights is gone: name the network alone"),
        (["watch", "--weights=robot_pong"], "^--weights is gone: name the network alone"),
        (["human", "--weights", "w"], "^there is no flag --weights"),
        (["check", "--weights", "w"], "^there is no flag --weights"),
        (["draws", "--weights", "w"], "^there is no flag --weights"),
        (["check", "--randomise.all"], r"^there is no flag --randomise\.all"),
        (["play", "--viewer", "foo"], r"^--viewer is 'foo': choose one of 'rerun';"),
        (["play", "ale_pong", "robot_pong"], "^robot_pong .* is one too many"),
        (["play", "--epsilon", "1.5"], "--epsilon is 1.5"),
        (["play", "--video", "v.gif"], "--seconds up to 120, or an .mp4"),
        (["play", "--video", "V.GIF"], "--seconds up to 120, or an .mp4"),
        (["play", "--video", "v.gif", "--seconds", "121"], "--seconds up to 120, or an .mp4"),
        (["film", "--video", "v.gif"], "--seconds up to 120, or an .mp4"),
        (["record", "ale_pong", "-o", "r", "--games", "3", "--minutes", "1"], "omit one of them"),
        (["play", "--games", "0"], "--games is 0"),
        (["play", "--seconds", "-1"], "--seconds is -1"),
        (["play", "--speed", "2"], "--speed is for --no-sync"),
        (["play", "--env", "ale", "--no-sync"], "--no-sync is for a robot"),
        (["check", "--seed", "-1"], "--seed is -1"),
        (["check", "--game", "pomg"], "did you mean pong"),
        (["check", "-o", "p.txt"], r"p\.txt does not name a picture"),
        (["check", "-o", "p.pgm"], r"p\.pgm does not name a picture"),
        (["film", "--game", "pomg"], "did you mean pong"),
        (["film", "--video", "f.txt"], r"let it end in \.mp4 or \.gif"),
        (["film", "policies"], "is not a run: name one"),
    ],
)
def test_flags_that_cannot_be_followed_are_told_before_pytorch_is_loaded(
    arguments: list[str], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    hide_pytorch(monkeypatch)
    with pytest.raises(InputError, match=words):
        command(monkeypatch, *arguments)


@dataclass(frozen=True)
class TallSettings:
    reach: float = 1.0
    depth: int = 1


@pytest.mark.parametrize(
    ("flags", "judged"),
    [
        ((), {"pixel deviation", "valid frames", "corners within 1.5 px", "keys as commanded"}),
        (
            ("--play.actuation-latency", "8"),
            {"pixel deviation", "valid frames", "corners within 1.5 px"},
        ),
        (("--play.eye", "emulator"), {"pixel deviation", "keys as commanded"}),
        (("--env", "ale"), {"pixel deviation"}),
    ],
)
def test_a_check_judges_only_what_the_settings_let_it_tell(
    flags: tuple[str, ...],
    judged: set[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("viewer.check.AGENT_STEPS", 20)
    monkeypatch.setattr("viewer.check._changes", lambda env, seed, stop: [])
    assert command(monkeypatch, "check", "-o", str(tmp_path / "c.png"), *flags) == 0
    told = capsys.readouterr().out
    assert set(re.findall(r"│ (\S.*?) +│ .* green │", told)) == judged
    assert "red" not in told


def test_what_differs_from_the_training_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    weights = str(in_run(tmp_path, SHORT, 6))
    told = "other than trained: play.sticky 0.0 → 0.25, camera.noise 0.0 → 8.0\n"
    flags = ("--play.sticky", "0.25", "--camera.noise", "8", "--seed", "3")
    assert command(monkeypatch, "play", weights, *flags) == 0
    assert capsys.readouterr().out.startswith(told + "game 1: ")
    assert command(monkeypatch, "play", weights, "--seed", "3") == 0
    assert capsys.readouterr().out.startswith("game 1: ")
    assert command(monkeypatch, "play", "--camera.noise", "8", "--seconds", "0.1") == 0
    assert "trained" not in capsys.readouterr().out


def test_the_help_beside_a_network_shows_what_it_was_trained_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    play = replace(SHORT.play, equal_latency=11)
    weights = str(in_run(tmp_path, replace(SHORT, game="breakout", seed=84, play=play), 4))
    for named, shown in (([weights], ("breakout", 84, 11)), ([], ("pong", 1, 0))):
        with pytest.raises(SystemExit) as left:
            command(monkeypatch, "play", *named, "--help")
        assert left.value.code == 0
        told = " ".join(re.sub(r"[│\s]+", " ", capsys.readouterr().out).split())
        usual = re.findall(
            r"--(game|seed|play\.equal-latency) (?:STR|INT) .*?\(default: (\S+)\)", told
        )
        assert [value for _, value in usual] == list(map(str, shown))


def test_a_card_names_the_settings_that_are_shown(tmp_path: Path) -> None:
    """It has those of learning too, for which there are no flags here."""
    weights = in_run(tmp_path, SHORT, 6)
    card = tmp_path / "card.json"
    noisy = replace(SHORT, game="breakout", camera=CameraConfig(noise=3.0))
    card.write_text(to_json(noisy))
    found = parsed(Play, "--config", card, "--play.sticky", 0.25)
    assert (found.game, found.camera.noise, found.play.sticky) == ("breakout", 3.0, 0.25)
    assert found.play.minimal_actions
    with pytest.raises(InputError, match="trained with 6 actions"):
        parsed(Play, weights, "--config", card).config()


def test_a_robots_own_settings_go_over_those_of_the_run(tmp_path: Path) -> None:
    tall = RobotKind("tall", "nowhere:tall", joints=8, settings=TallSettings)
    play = replace(PRESETS["robot"].play, robot="tall", robot_settings="reach=2 depth=3")
    weights = in_run(tmp_path, replace(PRESETS["robot"], play=play), 6)
    own = "--play.robot-settings"
    with added(ROBOTS, tall):
        for flags, text in (
            ((), "reach=2 depth=3"),
            (("--robot", "tall", own, "depth=4"), "reach=2 depth=4"),
            ((own, ""), ""),
            (("--robot", "nao"), ""),
        ):
            assert parsed(Play, weights, *flags).config().play.robot_settings == text
        alone = parsed(Play, "--robot", "tall", own, "reach=2")
        assert alone.config().play.robot_settings == "reach=2"
        with pytest.raises(InputError, match=r"play\.robot_settings\.depth is 'x'"):
            parsed(Play, weights, own, "depth=x").config()


def test_a_latency_model_keeps_the_rate_of_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("m.npz", "other.npz"):
        Path(name).write_bytes(name.encode())
    hashed = f"m.npz#sha256={'0' * 64}"
    play = replace(PRESETS["robot"].play, robot=hashed, robot_settings="rate=60")
    weights = in_run(tmp_path, replace(PRESETS["robot"], play=play), 6)
    for robot in ("m.npz", "other.npz"):
        found = parsed(Play, weights, "--robot", robot).config().play
        assert found.robot_settings == "rate=60"
        assert found.robot == pin(robot)  # a recording tells which file it was
    assert parsed(Play, weights, "--robot", "nao").config().play.robot_settings == ""


def test_what_is_played_comes_from_the_run_of_the_weights(tmp_path: Path) -> None:
    ran = replace(PRESETS["fast"], game="breakout")
    drawing = replace(ran, randomise=RandomiseConfig(actuation_latency=3))
    weights = in_run(tmp_path, drawing, 4)
    assert parsed(Play, weights).config() == ran
    flags = ("--env", "robot", "--game", "kaboom", "--seed", "3")
    changed = replace(ran, env="robot", game="kaboom", seed=3)
    assert parsed(Play, weights, *flags).config() == changed
    alone = tmp_path / "alone.safetensors"
    alone.write_bytes(encode_weights(build_network(ran, 18)))
    assert parsed(Play, alone).config().play.minimal_actions is False
    own_actions = parsed(Play, "--env", "ale", "--play.minimal-actions").config()
    assert (own_actions.play.minimal_actions, own_actions.preset) == (True, "fast")
    assert parsed(Play).config().env == "robot"
    assert parsed(Play, weights, "--seed", "0").config().seed == 0
    with pytest.raises(InputError, match="trained with 4 actions, and here it would have 18"):
        parsed(Play, weights, "--game", "pitfall").config()
    model = tmp_path / "a.npz"
    model.write_bytes(b"")
    followed = parsed(Play, weights, "--robot", model).config()
    assert followed.play == replace(ran.play, robot=pin(str(model)))
    with pytest.raises(InputError, match="there is no robot 'atlas'"):
        parsed(Play, "--robot", "atlas").config()
    with pytest.raises(InputError, match=r"^--robot robotroller is for a robot, and --env ale has"):
        parsed(Play, weights, "--robot", "robotroller").config()


def test_a_network_is_shown_in_another_world_than_its_own(tmp_path: Path) -> None:
    ran = replace(
        PRESETS["robot"],
        play=replace(PRESETS["robot"].play, sticky=0.25, actuation_latency=4),
        camera=CameraConfig(noise=5.0, gamma=1.2),
    )
    weights = in_run(tmp_path, ran, 6)
    # What is given holds even if it is the usual value; all else is as in the run.
    world = ("--play.sticky", 0, "--camera.noise", 8, "--camera.gamma", 1)
    found = parsed(Play, weights, *world).config()
    assert found == replace(ran, play=replace(ran.play, sticky=0.0), camera=CameraConfig(noise=8.0))
    with pytest.raises(InputError, match=r"^--camera\.noise is 300(\.0)?: choose at most 255"):
        parsed(Play, weights, "--camera.noise", 300).config()


def test_without_a_robots_joints_the_emulators_network_plays_by_a_robot(tmp_path: Path) -> None:
    play = replace(PRESETS["fast"].play, vector=True)
    config = replace(PRESETS["fast"], play=play)
    weights = tmp_path / "w.safetensors"
    weights.write_bytes(encode_network_file(build_network(config, 6), config))
    with pytest.raises(InputError, match=r"of proprioception: give .*--env ale"):
        parsed(Play, weights, "--env", "robot").config()
    found = parsed(Play, weights, "--env", "robot", "--play.no-vector-joints").config()
    assert (found.env, found.vector_width) == ("robot", config.vector_width)


@dataclass(frozen=True)
class Reach:
    reach: float = 0.4


def test_another_robot_is_watched_without_the_settings_of_the_former(tmp_path: Path) -> None:
    nao = ROBOTS.find("nao")
    tall = RobotKind("tall", nao.factory, joints=nao.joints, settings=Reach)
    world = Environment(
        "world", "nowhere:world", lambda config: 4, lambda play: 0, robot=True, settings=Reach
    )
    play = PRESETS["fast"].play
    play = replace(play, robot="tall", robot_settings="reach=1", env_settings="reach=2")
    ran = replace(PRESETS["fast"], env="world", game="breakout", play=play)
    with added(ROBOTS, tall), added(ENVIRONMENTS, world):
        weights = in_run(tmp_path, ran, 4)
        cases: tuple[tuple[tuple[str, ...], dict[str, Any]], ...] = (
            ((), {}),
            (("--env", "world", "--robot", "tall"), {}),
            (("--play.env-settings", "reach=3"), {"env_settings": "reach=3"}),
            (("--robot", "nao"), {"robot": "nao", "robot_settings": ""}),
            (("--env", "ale"), {"env_settings": ""}),
        )
        for flags, changes in cases:
            assert parsed(Play, weights, *flags).config().play == replace(play, **changes)


def test_weights_that_do_not_fit(tmp_path: Path) -> None:
    weights = in_run(tmp_path, SHORT, 6)
    all_actions = replace(SHORT, play=replace(SHORT.play, minimal_actions=False))
    with pytest.raises(InputError, match=r"with 18 actions.*--play\.minimal-actions"):
        ShownPolicy.of_file(all_actions, weights, 0.0, 0)
    weights.write_bytes(b"no weights")
    with pytest.raises(InputError, match=r"holds no network .*: name a \.safetensors file"):
        ShownPolicy.of_file(SHORT, weights, 0.0, 0)
    with pytest.raises(InputError, match="there is no "):
        ShownPolicy.of_file(SHORT, tmp_path / "none", 0.0, 0)


def test_a_lost_life_ends_no_episode_that_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[AtariEnv] = []
    monkeypatch.setattr(AtariEnv, "close", lambda env: closed.append(env))
    play = replace(PRESETS["fast"].play, random_starts=0, minimal_actions=True)
    with shown_env(replace(PRESETS["fast"], game="breakout", play=play)) as env:
        assert isinstance(env, AtariEnv)
        env.reset(seed=0)
        lives, terminated = env.emulator.lives, False
        for _ in range(500):  # the ball is launched, and nobody returns it
            if env.emulator.lives == lives:
                terminated = env.step(np.int64(1))[2]
        assert env.emulator.lives == lives - 1
        assert not terminated
    assert closed == [env]


def test_the_shown_values_are_the_networks(tmp_path: Path) -> None:
    weights = in_run(tmp_path, SHORT, 6)
    policy = ShownPolicy.of_file(SHORT, weights, 0.0, 0)
    frames = np.random.default_rng(0).integers(0, 256, (1, 4, 84, 84), np.uint8)
    (action,) = policy.act(frames, np.zeros((1, 0), np.float32))
    assert policy.values is not None
    assert policy.values.shape == (6,)
    assert action == policy.values.argmax()
    mostly_random = ShownPolicy.of_file(SHORT, weights, 0.99, 0)
    mostly_random.act(frames, np.zeros((1, 0), np.float32))
    np.testing.assert_array_equal(mostly_random.values, policy.values)
    random = ShownPolicy.of_file(SHORT, None, 0.0, 0)
    random.act(frames, np.zeros((1, 0), np.float32))
    assert random.values is None


CHANGES = [
    Change(0, 1, settled=True, frames=3, strayed=False),
    Change(1, 2, settled=True, frames=5, strayed=True),
    Change(2, 3, settled=False, frames=4, strayed=False),
    Change(3, 4, settled=False, frames=None, strayed=False),
]


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A check that is over soon."""
    monkeypatch.setattr(viewer.check, "AGENT_STEPS", 20)
    monkeypatch.setattr(viewer.check, "changes", lambda room, repetitions, seed: CHANGES)


@pytest.mark.usefixtures("short")
def test_check_is_green_and_writes_four_panels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "new" / "check[seed].png"
    urdf = write_nao(tmp_path)
    assert command(monkeypatch, "check", "-o", str(path), "--nao-urdf", str(urdf)) == 0
    said = capsys.readouterr().out
    for words in ("valid frames", "pixel deviation", "corners", "keys as", "p50", "p99"):
        assert words in said
    assert said.count("│ green │") == 4
    assert "red:" not in said
    # Of 3 and 5 frames, and of 4 alone.
    assert re.search(r"p50 +│ +50\.0 ms │ 66\.7 ms │ +≤ 66\.7 ms", said)
    assert re.search(r"p99 +│ +83\.3 ms │ 66\.7 ms │ +≤ 133\.3 ms", said)
    assert re.search(r"not reached +│ +0 │ +1 │", said)
    assert re.search(r"stray key, % +│ +50\.0 │ +0\.0 │", said)
    assert said.endswith(f"\nwrote {path}\n")
    assert size_of(path) == (768, 1024, 3)


@pytest.mark.usefixtures("short")
@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("check", "-o", "check.png"), ["checking: 95 %, 19 steps", "timing the hands: 0 %, 1 ch"]),
        (("film", "--env", "ale", "--seconds", "0.2"), ["filming: 67 %, 0 s of play"]),
        (("play", "--env", "ale", "--seconds", "0.2"), ["playing: 67 %, 0 s of play"]),
        (
            ("record", "ale_pong", "-o", "d", "--minutes", "0.01"),
            ["recording: 78 %, 7 steps"],
        ),
    ],
    ids=lambda each: each[0],
)
def test_without_a_terminal_commands_say_how_far_they_are(
    arguments: tuple[str, ...],
    told: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("common.process.progress.PLAIN_SECONDS", 0.0)
    monkeypatch.chdir(tmp_path)
    assert command(monkeypatch, *arguments) == 0
    said = capsys.readouterr()
    for words in told:
        assert words in said.err
        assert words not in said.out


@pytest.mark.usefixtures("short")
def test_a_check_that_is_stopped_judges_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stop = threading.Event()
    stop.set()
    assert Check(output=tmp_path / "check.png").run(stop) == INTERRUPTED
    said = capsys.readouterr().out
    assert said == f"stopped after 1 of {viewer.check.AGENT_STEPS} agent steps\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("short")
def test_a_check_that_is_stopped_later_does_not_judge_the_hands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stop = threading.Event()

    def changes(*_: Any) -> Iterator[Change]:
        for change in CHANGES:
            stop.set()
            yield change

    monkeypatch.setattr(viewer.check, "changes", changes)
    assert Check(output=tmp_path / "check.png").run(stop) == INTERRUPTED
    said = capsys.readouterr().out
    assert said.count("│ green │") == 4
    assert said.endswith("stopped before the hands were timed\n")
    assert "command →" not in said


@pytest.mark.usefixtures("short")
def test_check_of_a_latency_model_does_not_judge_its_promptness(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    model = saved(tmp_path / "hand.npz", delay(29))
    arguments = ("check", "--robot", model, "-o", str(tmp_path / "check.png"))
    assert command(monkeypatch, *arguments) == 0
    said = capsys.readouterr().out
    assert said.count("│ green │") == 3
    assert "keys as commanded" not in said


def test_check_of_the_emulator_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "check.png"
    arguments = ("check", "--env", "ale", "--game", "breakout", "-o", str(path))
    assert command(monkeypatch, *arguments) == 0
    said = capsys.readouterr().out
    assert "breakout (ale)" in said
    assert "keys as commanded" not in said
    assert size_of(path) == (384, 1024, 3)


@pytest.mark.usefixtures("short")
def test_check_of_an_environment_from_outside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "check.png"
    with added(ENVIRONMENTS, LAMPS):
        assert command(monkeypatch, "check", "--env", "lamps", "-o", str(path)) == 0
    said = capsys.readouterr().out
    assert "lamps, 20 random agent steps" in said
    assert said.count("│ green │") == 1
    assert "rewards are as a replay needs them; 2 games ended within these steps." in said
    assert size_of(path) == (384, 1024, 3)


@pytest.mark.usefixtures("short")
def test_check_is_red_for_a_robot_that_is_blind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its detector is shown a grey wall, as in 2017, when nobody was told."""
    detect = Eye._detect

    def look_at_a_wall(eye: Eye) -> None:
        detect(eye)
        eye._picture = np.full_like(eye.picture, 128)
        eye.detection = ScreenDetector().detect(eye.picture)

    monkeypatch.setattr(Eye, "_detect", look_at_a_wall)
    assert command(monkeypatch, "check", "-o", str(tmp_path / "p.png")) == 1
    said = capsys.readouterr().out
    assert said.count("red:") == 3
    assert "the screen is not found" in said


def test_bound_of_the_corners() -> None:
    assert CORNERS_IN_PLACE.admits(0.99)
    assert not CORNERS_IN_PLACE.admits(0.985)


@pytest.mark.parametrize("name", ["p.nonsense", "file/p.png"])
def test_a_picture_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(viewer.check, "AGENT_STEPS", 1)
    with pytest.raises(InputError, match=r"p\."):
        command(monkeypatch, "check", "--env", "ale", "-o", str(tmp_path / name))


def test_play_prints_scores_and_records_every_agent_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    weights = in_run(tmp_path, SHORT, 6)
    pytest.importorskip("av")
    video = tmp_path / "film.mp4"
    arguments = ("play", str(weights), "--video", str(video), "--games", "2")
    assert command(monkeypatch, *arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["game 1: score 0 in 4 steps", "game 2: score 0 in 4 steps"]
    assert lines[2:] == ["mean score of 2 games: 0.00", f"wrote {video}"]
    assert pictures_in(video) == 8


def pictures_in(video: Path) -> int:
    film = cv2.VideoCapture(str(video))
    pictures = 0
    while film.read()[0]:
        pictures += 1
    return pictures


def test_a_film_in_real_time_lasts_as_long_as_its_game(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    weights = in_run(tmp_path, SHORT, 6)
    pytest.importorskip("av")
    video = tmp_path / "film.mp4"
    arguments = ("play", str(weights), "--video", str(video), "--no-sync")
    assert command(monkeypatch, *arguments) == 0
    assert pictures_in(video) == 4  # agent steps of the game, in however few steps


def test_play_ends_after_so_many_seconds_of_play(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    weights = in_run(tmp_path, replace(SHORT, env="ale"), 6)
    arguments = ("play", str(weights), "--seconds", "0.6")
    assert command(monkeypatch, *arguments) == 0
    # 0.6 s are 9 agent steps of 66.7 ms: two games of 4, and one of the next.
    assert capsys.readouterr().out.splitlines()[2:] == ["mean score of 2 games: 0.00"]


def test_play_that_ends_before_its_first_game_tells_the_score_so_far(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    weights = in_run(tmp_path, replace(SHORT, env="ale"), 6)
    assert command(monkeypatch, "play", str(weights), "--seconds", "0.2") == 0
    assert capsys.readouterr().out == "no game ended: score 0 after 3 steps\n"


def test_play_in_real_time_tells_how_often_it_was_late(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    weights = in_run(tmp_path, SHORT, 6)
    assert command(monkeypatch, "play", str(weights), "--no-sync") == 0
    assert re.fullmatch(
        r"game 1: score 0 in 4 steps, \d+ deadlines missed\n", capsys.readouterr().out
    )


def test_play_on_the_emulator_alone_is_the_same_game_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    weights = in_run(tmp_path, replace(SHORT, env="ale"), 6)
    video = tmp_path / "film.gif"
    arguments = ["play", str(weights), "--epsilon", "0.5", "--seed", "3"]
    arguments += ["--seconds", "60"]  # more than the game has
    assert command(monkeypatch, *arguments) == 0
    first = capsys.readouterr().out
    pytest.importorskip("PIL")
    assert command(monkeypatch, *arguments, "--video", str(video)) == 0
    assert capsys.readouterr().out == f"{first}wrote {video}\n"


@pytest.mark.parametrize(
    ("arguments", "package", "extra"),
    [
        (["play", "--viewer", "rerun"], "rerun", "viz"),
        (["play", "--save", "game.rrd"], "rerun", "viz"),
        (["record", "ale_pong", "-o", "recording"], "pyarrow", "record"),
        (["human", "--record", "recording"], "pyarrow", "record"),
    ],
)
def test_a_package_that_is_not_installed_is_told_before_pytorch_is_loaded(
    monkeypatch: pytest.MonkeyPatch, arguments: list[str], package: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    hide_pytorch(monkeypatch)
    with pytest.raises(InputError, match=rf"{package}, .*: pip install 'ale-robot\[{extra}\]'"):
        command(monkeypatch, *arguments)


def test_another_nao_is_for_films(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="add --video FILE"):
        command(monkeypatch, "play", "--nao-urdf", "own.urdf")


def test_play_is_saved_for_rerun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rerun", reason="needs pip install 'ale-robot[viz]'")
    weights = in_run(tmp_path, replace(SHORT, env="ale"), 6)
    path = tmp_path / "game.rrd"
    assert command(monkeypatch, "play", str(weights), "--save", str(path)) == 0
    assert capsys.readouterr().out.endswith(f"wrote {path}\n")
    found = recorded(path)
    assert list(found["/q/noop"]["Scalars:scalars"]) == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["watch", "--env", "ale"], "pictures and keys need a terminal"),
        (["record", "ale_pong", "-o", "here"], "here already exists: name a new folder"),
    ],
)
def test_what_cannot_work_is_refused_before_pytorch_is_loaded(
    arguments: list[str], words: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["viewer", *arguments])
    hide_pytorch(monkeypatch)
    with pytest.raises(InputError, match=words):
        main()


@pytest.mark.parametrize(
    ("kind", "told"),
    [(Play, ["stopping ..."]), (Check, ["stopping ..."]), (Watch, []), (Human, [])],
)
def test_a_stop_is_told_at_once_but_in_no_picture(
    monkeypatch: pytest.MonkeyPatch, kind: type[Played], told: list[str]
) -> None:
    said: Queue[str] = Queue()
    goes_on = threading.Event()

    def say(text: str) -> None:
        said.put(text)
        goes_on.wait(PATIENCE)

    def run(self: object, stop: threading.Event) -> None:
        before = set(threading.enumerate())
        stop.set()
        assert stop.is_set()
        assert [said.get(timeout=PATIENCE) for _ in told] == told
        assert len(set(threading.enumerate()) - before) == len(told)

    monkeypatch.setattr("viewer.__main__.say_aside", say)
    monkeypatch.setattr(kind, "check", lambda self: None)
    monkeypatch.setattr(kind, "run", run)
    try:
        assert command(monkeypatch, kind.__name__.lower()) == 0
    finally:
        goes_on.set()

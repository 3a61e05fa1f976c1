"""Films of how a run learned: chapters, titles, and what is refused."""

import threading
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from actors.envs.shown_env import ShownEnv
from actors.loop import Step, play
from actors.policy import Policy
from common.errors import InputError
from common.network import build_network
from common.protocol.weights import encode_weights
from common.registry import ENVIRONMENTS, ROBOTS
from common.run.epochs import COLUMNS, EpochTable
from common.run.folder import RunFolder
from common.run.network_file import encode_network_file
from common.run.newest_learner import NewestLearner
from common.run.origin import find_weights
from common.settings.presets import PRESETS
from common.settings.stored_config import to_json
from tests.common.run.test_epochs import TRAIN as ROW
from tests.extending.test_environment import CONFIG as LAMPS_CONFIG
from tests.extending.test_environment import LAMPS
from tests.extending.test_robot import FINGER
from tests.extending.test_robot import config as finger_config
from tests.extending.whole_run import added
from tests.viewer.commands import parsed
from viewer import overlay
from viewer.film import Chapter, Film, chapters_of, titled
from viewer.panels import Panels
from viewer.player import shown_env
from viewer.show import Play

CONFIG = replace(PRESETS["fast"], learning=replace(PRESETS["fast"].learning, network="nips"))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run of two epochs, of which the second is not tested yet."""
    folder = tmp_path / "runs" / "r"
    (folder / "snapshots").mkdir(parents=True)
    (folder / "config.json").write_text(to_json(CONFIG))
    weights = encode_weights(build_network(CONFIG, 6))
    for name in ("best", "epoch-0001", "epoch-0002"):
        (folder / "snapshots" / f"{name}.safetensors").write_bytes(weights)
    return folder


def test_chapters_are_random_play_and_each_snapshot_with_what_was_reached(run: Path) -> None:
    table = EpochTable(run / "epochs.csv")
    for row in (
        replace(ROW, epoch=0, phase="random"),
        replace(ROW, epoch=1, total_train_steps=50_048, total_time=3_725.0),
        replace(ROW, epoch=1, phase="test", average_reward=-12.345),
        replace(ROW, epoch=2, total_train_steps=100_096, total_time=7_500.0),
    ):
        table.append(row)
    snapshots = run / "snapshots"
    assert chapters_of(run) == [
        Chapter("random play", None),
        Chapter(
            "epoch 1   50,048 steps   1:02 h   test score -12.3",
            snapshots / "epoch-0001.safetensors",
        ),
        # Not tested: runs without an evaluator never are.
        Chapter(
            "epoch 2   100,096 steps   2:05 h   score in training -20.1",
            snapshots / "epoch-0002.safetensors",
        ),
    ]
    table.append(replace(ROW, epoch=2, phase="test", average_reward=0.0))
    assert chapters_of(run)[-1].title.endswith("test score 0.0")


def test_a_run_that_began_with_a_network_is_filmed_from_it(run: Path) -> None:
    (run / "initial.safetensors").write_bytes(encode_weights(build_network(CONFIG, 6)))
    first, *_ = chapters_of(run)
    assert first == Chapter("the network that the run began with", run / "initial.safetensors")


def pictures_of(video: Path) -> list[NDArray[Any]]:
    with av.open(str(video)) as film:
        return [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]


def test_a_run_is_filmed_chapter_by_chapter(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("common.process.progress.PLAIN_SECONDS", 0.0)
    parsed(Film, run, "--seconds", 0.2).run(threading.Event())
    video = run / "films" / "learning.mp4"
    told = capsys.readouterr()
    assert told.out == f"wrote {video}\n"
    assert "filming: 44 %, epoch 1" in told.err
    pictures = pictures_of(video)
    assert len(pictures) == 3 * 3  # chapters of 0.2 s at 15 a second
    titles = [picture[:32, :300].astype(int) for picture in pictures]
    bars = [int((picture[33:36].mean(axis=(0, 2)) > 100).sum()) for picture in pictures]
    assert bars == pytest.approx([1_024 * done / 9 for done in range(1, 10)], abs=8)
    for at in range(1, 9):  # the title changes with the chapter, and only then
        assert (np.abs(titles[at] - titles[at - 1]).max() > 100) == (at % 3 == 0)


def test_the_shortest_chapter_has_a_picture(run: Path) -> None:
    parsed(Film, run, "--seconds", 0.001).run(threading.Event())
    assert len(pictures_of(run / "films" / "learning.mp4")) == 3


def test_a_film_of_a_run_has_its_flags_and_shows_each_networks_values(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[Any] = []

    class Shown(Panels):
        def __init__(
            self, env: ShownEnv[Any, Any], nao_urdf: Path | None, *, orbiting: bool
        ) -> None:
            super().__init__(env, orbiting=orbiting)
            shown.append((nao_urdf, orbiting))

        def draw(self, step: Step, values: NDArray[np.float32] | None) -> NDArray[np.uint8]:
            shown.append((step.info.game_steps, step.a_tm1, step.epsilon, values is None))
            return super().draw(step, values)

    monkeypatch.setattr("viewer.film.Panels", Shown)
    for seed in (5, 6):
        flags = ("--seed", seed, "--seconds", 0.07, "--epsilon", 0.25, "--nao-urdf", "own.urdf")
        parsed(Film, run, *flags).run(threading.Event())
    first, other = shown[:4], shown[4:]
    assert first[0] == (Path("own.urdf"), True)
    assert [told[2:] for told in first[1:]] == [(1.0, True), (0.25, False), (0.25, False)]
    assert first[1][0] != other[1][0]  # another random start
    assert first[1][1] != other[1][1]  # another random action


def test_a_film_that_is_stopped_ends_with_its_last_picture_and_says_so(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stop = threading.Event()
    stop.set()
    video = run / "films" / "learning.mp4"
    parsed(Film, run).run(stop)
    assert len(pictures_of(video)) == 1
    assert capsys.readouterr().out == f"stopped after 0.1 s of play\nwrote {video}\n"
    best, video = run / "snapshots" / "best.safetensors", run / "best.mp4"
    parsed(Film, best, "--video", video).run(stop)
    assert len(pictures_of(video)) == 1
    told = f"\nstopped after 0.1 s of play\nwrote {video}\n"
    assert capsys.readouterr().out.endswith(told)
    # Three chapters by default are no 120 s.
    parsed(Film, run, "--video", run / "short.gif").run(stop)


def test_an_environment_from_outside_is_filmed_as_it_renders_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    weights = tmp_path / "lamps.safetensors"
    weights.write_bytes(encode_network_file(build_network(LAMPS_CONFIG, 3), LAMPS_CONFIG))
    video = tmp_path / "lamps.mp4"
    with added(ENVIRONMENTS, LAMPS):
        parsed(Film, weights, "--video", video, "--seconds", 2.4).run(threading.Event())
        # Another player of the same seeds.
        policy_seed, env_seed = map(
            int, np.random.SeedSequence(LAMPS_CONFIG.seed).generate_state(2)
        )
        policy = Policy.of_file(LAMPS_CONFIG, weights, 0.001, policy_seed)
        with shown_env(LAMPS_CONFIG) as env:
            steps = [
                (step.info.game_score, step.s_t[-1].copy())
                for step in islice(play([env], policy, [env_seed]), 12)
            ]
    told = capsys.readouterr().out
    assert told == f"game 1: score {steps[9][0]:g} in 10 steps\nwrote {video}\n"

    with av.open(str(video)) as film:
        assert film.streams.video[0].average_rate == 5  # as its metadata say
    pictures = pictures_of(video)
    assert len(pictures) == 12  # of two games, because 2.4 s are 12 steps
    for picture, (_, frame) in zip(pictures, steps, strict=True):
        assert picture.shape == (384, 1024, 3)
        lit = [bool(frame[42, 14 + 28 * lamp]) for lamp in range(3)]
        assert sum(lit) == 1
        for lamp, is_lit in enumerate(lit):
            shown = picture[192, 85 + 171 * lamp].astype(int)
            assert np.abs(shown - ((250, 220, 0) if is_lit else (0, 0, 200))).max() < 12
            given = picture[170, 512 + 8 + 56 + 112 * lamp]
            assert np.abs(given.astype(int) - 255 * is_lit).max() < 12
        # As wide as the panel, with margins above and below.
        margins = picture[[*range(4, 58), *range(328, 356)], :508].astype(int)
        assert np.abs(margins - margins[0, 0]).max() < 12
        assert (np.ptp(picture[70:314, 4], axis=0) < 24).all()


def test_a_robot_from_outside_is_filmed_by_its_own_views(tmp_path: Path) -> None:
    video = tmp_path / "finger.mp4"
    weights = tmp_path / "finger.safetensors"
    config = finger_config()
    with added(ROBOTS, FINGER):
        network = build_network(config, config.action_count)
        weights.write_bytes(encode_network_file(network, config))
        parsed(Film, weights, "--video", video, "--seconds", 0.2).run(threading.Event())
    pictures = pictures_of(video)
    assert len(pictures) == 3
    for picture in pictures:
        assert picture.shape == (768, 1024, 3)
        # Its room and its camera's picture are black, its hands are white.
        assert picture[4:350, 4:500].max() < 12
        assert picture[4:350, 520:1020].max() < 12
        assert picture[480:730, 4:500].min() > 243
        # The network gets Pong, whose field is one grey.
        assert 60 < picture[540:560, 660:680].mean() < 110


def test_a_title_stands_above_the_picture() -> None:
    picture = np.full((40, 200, 3), 9, np.uint8)
    found = titled(picture, "epoch 1", 0.25)
    assert found.shape == (76, 200, 3)
    assert (found[36:] == picture).all()
    assert found[:33].max() > 200
    assert (found[33:36] == overlay.YELLOW).all(axis=2).sum(axis=1).tolist() == [50] * 3


def test_a_gif_of_a_run_is_no_longer_than_one_of_a_game(run: Path) -> None:
    gif = run / "films" / "f.GIF"
    with pytest.raises(InputError, match=r"choose --seconds up to 40, or an \.mp4"):
        parsed(Film, run, "--video", gif, "--seconds", 40.1).check()
    assert not gif.exists()
    parsed(Film, run, "--video", gif, "--seconds", 0.07).run(threading.Event())
    assert gif.exists()


def test_a_network_is_filmed_under_the_given_flags(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    filmed: list[Play] = []
    monkeypatch.setattr(Play, "run", lambda play, stop: filmed.append(play))
    shown = run / "snapshots" / "best.safetensors"
    flags = ("--epsilon", 0.5, "--seconds", 2.0, "--video", "v.mp4", "--nao-urdf", "own.urdf")
    world = ("--seed", 3, "--camera.noise", 8, "--play.sticky", 0.25)
    parsed(Film, shown, *flags, *world).run(threading.Event())
    (play,) = filmed
    assert play == parsed(Play, shown, *flags, *world)
    assert (play.seed, play.camera.noise, play.play.sticky) == (3, 8.0, 0.25)


def test_without_a_network_the_published_one_of_the_environment_is_filmed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    filmed = []
    monkeypatch.setattr(Play, "run", lambda play, stop: filmed.append(play.weights))
    by_default = {
        (): "robot_pong_sticky",
        ("--env", "ale"): "ale_pong_sticky",
        ("--game", "breakout"): "robot_breakout",
        ("--robot", "robotroller"): "robot_pong_robust",
    }
    for flags in by_default:
        parsed(Film, *flags).run(threading.Event())
    assert filmed == [find_weights(name) for name in by_default.values()]
    filmed.clear()
    parsed(Film, "--game", "zaxxon").run(threading.Event())  # at random
    assert filmed == [None]


def test_a_run_is_filmed_by_its_name(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    filmed: list[Path] = []
    monkeypatch.setattr(Film, "_time_lapse", lambda film, folder, stop: filmed.append(folder))
    monkeypatch.setattr(Play, "run", lambda play, stop: filmed.append(play.weights))
    for other in (None, "directory", "file"):
        if other == "directory":
            Path("r").mkdir()  # no run
        elif other == "file":
            Path("r").rmdir()
            Path("r").write_bytes((run / "snapshots" / "best.safetensors").read_bytes())
        parsed(Film, "r").run(threading.Event())
    assert filmed == [Path("runs/r"), Path("runs/r"), Path("r")]


def test_snapshots_that_wait_for_a_test_are_no_film_of_a_run(run: Path) -> None:
    folder = RunFolder(run.parent, run.name)
    learner = NewestLearner(str(run), "tcp/h:1", None, str(run), "go on", keeps_snapshots=True)
    learner.write(folder)
    assert len(chapters_of(run)) == 3
    replace(learner, keeps_snapshots=False).write(folder)
    with pytest.raises(InputError, match=r"has kept no snapshots: train with --keep-snapshots"):
        chapters_of(run)


def test_what_cannot_be_filmed_is_told(run: Path, tmp_path: Path) -> None:
    parsed(Film, run, "--video", "f.gif").check()  # its length depends on the run
    with pytest.raises(InputError, match="is not a run: name one"):
        parsed(Film, tmp_path)
    with pytest.raises(InputError, match="did you mean robot_pong"):
        parsed(Film, "robot_pnog")
    (run / "epochs.csv").write_text(",".join(COLUMNS) + "\n1,train,soon\n")
    with pytest.raises(InputError, match=r"epochs\.csv is damaged"):
        chapters_of(run)
    for file in (run / "snapshots").glob("epoch-*"):
        file.unlink()
    with pytest.raises(InputError, match=r"no snapshots: train with --keep-snapshots\.$"):
        chapters_of(run)
    (run / "checkpoint.safetensors").touch()
    with pytest.raises(InputError, match=r"or film one network: .*/checkpoint\.safetensors\.$"):
        chapters_of(run)

"""`record`: a dataset of a network's games that LeRobot itself reads."""

import errno
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

import av
import numpy as np
import pyarrow.parquet as pq
import pytest

from actors.envs import make_env
from actors.loop import play
from actors.policy import Policy
from common.dataset.layout import (
    CAMERA,
    DATA_PATH,
    EPISODES_PATH,
    INFO,
    STATISTICS,
    VIDEO_PATH,
    file_of,
)
from common.dataset.reader import Dataset
from common.errors import InputError
from learner.demonstrations.recording import Demonstrations
from tests.actors.numbered_env import GAME_OVER, GOES_ON
from tests.paths import ROOT
from tests.recordings import CONFIG, record
from tests.viewer.commands import parsed
from viewer.record import Record

POLICIES = ROOT / "policies"
ALE = POLICIES / "ale_pong.safetensors"
LEROBOT = os.environ.get("LEROBOT_PYTHON")
"""An interpreter that has the package lerobot, which needs an older PyTorch than this project."""


def test_a_recording_has_the_play_the_video_and_the_keys(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "d"
    command = parsed(Record, ALE, "-o", folder, "--minutes", 0.1, "--epsilon", 0.5)
    command.run(threading.Event())
    assert capsys.readouterr().out == f"wrote 1 game of 90 steps, cut at the end, to {folder}\n"

    # Another player of the same seeds sees and does the same.
    config = command.config()
    policy_seed, env_seed = map(int, np.random.SeedSequence(config.seed).generate_state(2))
    policy = Policy.of_file(config, ALE, 0.5, policy_seed)
    env = make_env(config, training=True)
    (rows,) = Dataset(folder).read()
    screens = []
    for at, step in enumerate(islice(play([env], policy, [env_seed]), 90)):
        assert np.array_equal(rows["frames"][at], step.s_tm1[-1])
        assert (rows["actions"][at], rows["rewards"][at]) == (step.a_tm1, step.r_t)
        screens.append(env.unwrapped.emulator.screen_rgb())  # type: ignore[attr-defined]
    assert rows["truncated"].tolist() == [False] * 89 + [True]

    with av.open(str(file_of(folder, VIDEO_PATH, 0, video_key=CAMERA))) as film:
        shown = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(shown) == 90
    # The picture of a row is what was seen before its action, but for the loss of the video.
    errors = [np.abs(a.astype(int) - b).mean() for a, b in zip(shown[1:], screens, strict=False)]
    assert max(errors) < 4
    table = pq.read_table(file_of(folder, DATA_PATH, 0))
    commands, keys = table["command"].to_pylist(), table["observation.keys"].to_pylist()
    assert keys[1:] == commands[:-1]  # the emulator's hands are prompt
    told = json.loads((folder / INFO).read_text())
    assert told["features"]["command"]["names"] == ["up", "down", "left", "right", "fire"]
    assert told["features"][CAMERA]["shape"] == [210, 160, 3]


def test_a_robots_joints_are_recorded(tmp_path: Path) -> None:
    weights = POLICIES / "robot_pong.safetensors"
    parsed(Record, weights, "-o", tmp_path / "d", "--minutes", 0.03).run(threading.Event())
    table = pq.read_table(file_of(tmp_path / "d", DATA_PATH, 0))
    joints = np.array(table["observation.state"].to_pylist())
    assert joints.shape == (27, 8)
    assert np.ptp(joints, axis=0).max() > 0.01
    assert np.abs(joints).max() <= 1
    (rows,) = Dataset(tmp_path / "d").read()
    assert rows["vectors"].shape[1] > 0  # of this network


def time_of(frame: av.VideoFrame) -> float:
    """In seconds from the film's begin."""
    assert frame.pts is not None
    assert frame.time_base is not None
    return float(frame.pts * frame.time_base)


def test_it_says_what_lerobot_says_of_a_dataset(tmp_path: Path) -> None:
    # As lerobot 0.4 writes them: https://huggingface.co/docs/lerobot/lerobot-dataset-v3.
    stop, folder = threading.Event(), tmp_path / "d"
    parsed(Record, ALE, "-o", folder, "--minutes", 0.1, "--epsilon", 0.5).run(stop)
    told = json.loads((folder / INFO).read_text())
    assert type(told["fps"]) is int
    assert (told["fps"], told["total_episodes"], told["total_frames"]) == (15, 1, 90)
    with av.open(str(file_of(folder, VIDEO_PATH, 0, video_key=CAMERA))) as film:
        stream = film.streams.video[0]
        times = [time_of(frame) for frame in film.decode(stream)]
        about = told["features"][CAMERA]["info"]
        size = stream.height, stream.width, stream.pix_fmt, stream.codec.name
    assert size == tuple(about[f"video.{key}"] for key in ("height", "width", "pix_fmt", "codec"))
    assert (about["video.channels"], about["video.fps"]) == (3, 15)
    table = pq.read_table(file_of(folder, DATA_PATH, 0))
    assert set(table.column_names) == told["features"].keys() - {CAMERA}
    found = table["timestamp"].to_numpy()
    assert found.dtype == np.float32
    assert np.abs(found - times).max() < 1e-4  # LeRobot's tolerance, in seconds

    # Each episode has statistics of its own, by which LeRobot's tools remove and split episodes.
    (episode,) = pq.read_table(file_of(folder, EPISODES_PATH, 0)).to_pylist()
    statistics = json.loads((folder / STATISTICS).read_text())
    assert statistics.keys() == told["features"].keys()
    for name, its in statistics.items():
        for key, value in its.items():
            assert np.array_equal(episode[f"stats/{name}/{key}"], value)
    assert statistics["action"]["mean"] == pytest.approx([table["action"].to_numpy().mean()])
    assert statistics["action"]["count"] == [90]
    keys = {"min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"}
    assert {frozenset(its) for its in statistics.values()} == {frozenset(keys)}
    assert statistics[CAMERA]["count"] == [3]  # pictures, not pixels
    colours = statistics[CAMERA]
    assert {np.shape(told) for key, told in colours.items() if key != "count"} == {(3, 1, 1)}
    assert 0 <= np.min(colours["min"]) < np.min(colours["q50"]) < np.max(colours["max"]) <= 1


def test_statistics_of_all_games_and_of_each(tmp_path: Path) -> None:
    record(tmp_path / "d", [GOES_ON, GAME_OVER, GOES_ON, GOES_ON, GAME_OVER], 5)
    games = [file_of(tmp_path / "d", EPISODES_PATH, game) for game in (0, 1)]
    (first,), (second,) = (pq.read_table(game).to_pylist() for game in games)
    rows = [pq.read_table(file_of(tmp_path / "d", DATA_PATH, game)) for game in (0, 1)]
    actions = [table["action"].to_numpy() for table in rows]
    both = np.concatenate(actions)
    for told, its in ((first, actions[0]), (second, actions[1])):
        assert told["stats/action/mean"] == pytest.approx([its.mean()])
        assert told["stats/action/max"] == [its.max()]
    told = json.loads((tmp_path / "d" / STATISTICS).read_text())["action"]
    assert told["count"] == [5]
    assert told["std"] == pytest.approx([both.std()])
    assert (told["min"], told["max"]) == ([both.min()], [both.max()])


@pytest.mark.parametrize("steps", [1, 2, 250])
def test_quantiles_are_values_that_so_large_a_share_does_not_exceed(
    steps: int, tmp_path: Path
) -> None:
    script = [GOES_ON] * (steps - 1) + [GAME_OVER]
    record(tmp_path / "d", script, steps)
    (told,) = pq.read_table(file_of(tmp_path / "d", EPISODES_PATH, 0)).to_pylist()
    columns = pq.read_table(file_of(tmp_path / "d", DATA_PATH, 0))
    for name in ("action", "next.reward", "timestamp", "observation.valid", "observation.frame"):
        rows = np.array(columns[name].to_pylist(), float).reshape(steps, -1)
        for key, share in (("q01", 0.01), ("q10", 0.1), ("q50", 0.5), ("q90", 0.9), ("q99", 0.99)):
            expected = np.quantile(rows, share, axis=0, method="inverted_cdf")
            found = np.ravel(told[f"stats/{name}/{key}"])
            assert found == pytest.approx(expected, rel=1e-6), (name, key)


def test_quantiles_of_games_are_their_weighted_mean(tmp_path: Path) -> None:
    # As `aggregate_stats` of lerobot has them.
    record(tmp_path / "d", [GOES_ON, GAME_OVER, *[GOES_ON] * 5, GAME_OVER], 8)
    games = [file_of(tmp_path / "d", EPISODES_PATH, game) for game in (0, 1)]
    (first,), (second,) = (pq.read_table(game).to_pylist() for game in games)
    told = json.loads((tmp_path / "d" / STATISTICS).read_text())["timestamp"]
    for key in ("q01", "q50", "q99"):
        (of_first,), (of_second,) = (each[f"stats/timestamp/{key}"] for each in (first, second))
        assert of_first != of_second or key == "q01"
        assert told[key] == pytest.approx([(2 * of_first + 6 * of_second) / 8])


def test_what_was_recorded_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stop = threading.Event()
    stop.set()
    command = parsed(Record, ALE, "-o", tmp_path / "d", "--games", 3)
    command.run(stop)
    assert "wrote 1 game of 1 step, cut at the end, to" in capsys.readouterr().out
    with pytest.raises(InputError, match=r"d already exists: name a new folder"):
        command.run(stop)


@contextmanager
def full_at_the_end(path: Path, rate: float) -> Iterator[Callable[[object], None]]:
    """A film that needs more room when it ends than there is."""
    yield lambda picture: None
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_game_whose_film_cannot_be_written_is_not_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("viewer.recorder.open_movie", full_at_the_end)
    command = parsed(Record, ALE, "-o", tmp_path / "d", "--minutes", 0.01)
    with pytest.raises(InputError, match=r"d cannot be written \(No space .* another folder\.$"):
        command.run(threading.Event())
    assert not (tmp_path / "d").exists()


def test_a_recording_that_cannot_begin_leaves_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    command = parsed(Record, ALE, "-o", tmp_path / "d", "--minutes", 0.01)
    with monkeypatch.context() as full:
        full.setattr("common.dataset.writer.write_atomically", refuse)
        with pytest.raises(InputError, match=r"d cannot be written \(No space left on device\)"):
            command.run(threading.Event())
    assert not (tmp_path / "d").exists()
    mkdir = Path.mkdir

    def make_but_for_videos(folder: Path, **how: bool) -> None:
        refuse() if "videos" in folder.parts else mkdir(folder, **how)

    monkeypatch.setattr(Path, "mkdir", make_but_for_videos)
    with pytest.raises(InputError, match=r"d cannot be written \(No space .* another folder\.$"):
        command.run(threading.Event())
    assert not (tmp_path / "d").exists()


def test_without_pyarrow_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("common.dataset.writer", "common.dataset.reader"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"a recording needs the package pyarrow.*\[record\]"):
        parsed(Record, ALE, "-o", tmp_path / "d").run(threading.Event())
    assert not (tmp_path / "d").exists()
    with pytest.raises(InputError, match=r"--demonstrations needs the package pyarrow"):
        Demonstrations(tmp_path / "d", CONFIG)


def test_one_that_was_killed_has_the_games_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Neither its video nor any file of the game that was going on is in the way.
    monkeypatch.setattr("viewer.recorder.Recorder.close", lambda recorder: None)
    record(tmp_path / "d", [GOES_ON, GOES_ON, GAME_OVER], 5)
    (rows,) = Dataset(tmp_path / "d").read()
    assert len(rows["actions"]) == 3
    assert rows["truncated"].tolist() == [False] * 3  # its game ended by itself


@pytest.mark.skipif(LEROBOT is None, reason="LEROBOT_PYTHON names no interpreter with lerobot")
def test_lerobot_reads_what_was_recorded(tmp_path: Path) -> None:
    assert LEROBOT is not None
    parsed(Record, ALE, "-o", tmp_path / "d", "--minutes", 0.2).run(threading.Event())
    (rows,) = Dataset(tmp_path / "d").read()
    script = """
import json, sys
import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset
found = LeRobotDataset("local/recording", root=sys.argv[1], video_backend="pyav")
pictures = [found[at]["observation.images.camera"].numpy() for at in (0, 60, len(found) - 1)]
np.save(sys.argv[2], pictures)
rows = [found.hf_dataset[at] for at in range(len(found))]
print(json.dumps({
    "episodes": found.num_episodes, "fps": found.fps, "task": found.meta.tasks.index.tolist(),
    "video": str(found.meta.get_video_file_path(0, found.meta.video_keys[0])),
    "frames": [row["observation.frame"].sum().item() for row in rows],
    "corner": [row["observation.frame"][40, 40:44].tolist() for row in rows],
    "actions": [row["action"].item() for row in rows],
    "rewards": [row["next.reward"].item() for row in rows],
    "truncated": [row["next.truncated"].item() for row in rows],
    "statistics": {key: its.tolist() for key, its in found.meta.stats["next.reward"].items()},
    "tasks": [found[0]["task"]],
}))
"""
    arguments = [LEROBOT, "-c", script, str(tmp_path / "d"), str(tmp_path / "pictures.npy")]
    offline = os.environ | {"HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path / "cache")}
    done = subprocess.run(arguments, env=offline, check=True, capture_output=True, text=True)
    found = json.loads(done.stdout.splitlines()[-1])
    assert (found["episodes"], found["fps"], found["task"]) == (1, 15, ["Play pong."])
    assert (tmp_path / "d" / found["video"]).is_file()
    assert found["frames"] == rows["frames"].sum(axis=(1, 2)).tolist()
    assert found["corner"] == rows["frames"][:, 40, 40:44].tolist()
    for name in ("actions", "rewards", "truncated"):
        assert found[name] == rows[name].tolist()
    statistics = found["statistics"]
    assert statistics["mean"] == pytest.approx([rows["rewards"].mean()])
    assert statistics["q01"] == [np.quantile(rows["rewards"], 0.01, method="inverted_cdf")]
    assert statistics["q99"] == [np.quantile(rows["rewards"], 0.99, method="inverted_cdf")]
    assert found["tasks"] == ["Play pong."]

    # It decodes the very picture of a row: others are of other moments.
    with av.open(str(file_of(tmp_path / "d", VIDEO_PATH, 0, video_key=CAMERA))) as film:
        shown = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    pictures = np.load(tmp_path / "pictures.npy").transpose(0, 2, 3, 1) * 255
    for picture, at in zip(pictures, (0, 60, len(shown) - 1), strict=True):
        errors = [float(np.abs(picture - each).mean()) for each in shown]
        assert errors[at] < 1
        assert errors[at] == min(errors)


def test_a_game_that_no_reader_would_take_is_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("viewer.recorder.MAX_EPISODE_STEPS", 5)
    script = [*[GOES_ON] * 8, GAME_OVER, GOES_ON, GAME_OVER]
    record(tmp_path / "d", script, len(script))
    games = list(Dataset(tmp_path / "d").read())
    assert [rows["truncated"].tolist() for rows in games] == [[False] * 4 + [True], [False] * 2]
    assert [bool(rows["terminated"][-1]) for rows in games] == [False, True]

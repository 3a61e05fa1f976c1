"""Films of how a run learned: chapters, titles, and what is refused."""

import threading
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

from common.errors import InputError
from common.network import build_network
from common.protocol.weights import encode_weights
from common.run.epochs import COLUMNS, EpochTable
from common.run.origin import find_weights
from common.run.presets import PRESETS
from common.run.stored_config import to_json
from tests.common.run.test_epochs import TRAIN as ROW
from viewer import overlay
from viewer.film import Chapter, Film, chapters_of, titled
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


def test_a_run_that_began_with_a_network_is_filmed_from_it(run: Path) -> None:
    (run / "initial.safetensors").write_bytes(encode_weights(build_network(CONFIG, 6)))
    first, *_ = chapters_of(run)
    assert first == Chapter("the network that the run began with", run / "initial.safetensors")


def test_a_run_is_filmed_chapter_by_chapter(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("common.process.progress.PLAIN_SECONDS", 0.0)
    Film(shown=run, seconds=0.2).run(threading.Event())
    video = run / "films" / "learning.mp4"
    told = capsys.readouterr()
    assert told.out == f"wrote {video}\n"
    assert "filming: 44 %, epoch 1" in told.err
    with av.open(str(video)) as film:
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(pictures) == 3 * 3  # chapters of 0.2 s at 15 a second
    titles = [picture[:32, :300].astype(int) for picture in pictures]
    bars = [int((picture[33:36].mean(axis=(0, 2)) > 100).sum()) for picture in pictures]
    assert bars == pytest.approx([1_024 * done / 9 for done in range(1, 10)], abs=8)
    for at in range(1, 9):  # the title changes with the chapter, and only then
        assert (np.abs(titles[at] - titles[at - 1]).max() > 100) == (at % 3 == 0)


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
        Film(shown=run, video=gif, seconds=40.1).run(threading.Event())
    assert not gif.exists()
    Film(shown=run, video=gif, seconds=0.07).run(threading.Event())
    assert gif.exists()


def test_without_a_network_the_published_one_of_the_environment_is_filmed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    filmed = []
    monkeypatch.setattr(Play, "run", lambda play, stop: filmed.append(play.weights))
    for env in (None, "ale"):
        Film(env=env).run(threading.Event())
    assert filmed == [find_weights("robot_pong_sticky"), find_weights("ale_pong_sticky")]


def test_what_cannot_be_filmed_is_told(run: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not the folder of a run"):
        Film(shown=tmp_path).run(threading.Event())
    with pytest.raises(InputError, match="did you mean robot_pong"):
        Film(shown=Path("robot_pnog")).check()
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

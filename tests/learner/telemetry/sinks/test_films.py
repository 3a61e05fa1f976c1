"""Films of epochs, by a stand-in that is quick and once by the real one."""

import shutil
import signal
from pathlib import Path

import av
import pytest

from common.run.epochs import EpochTable
from common.run.folder import RunFolder
from learner.telemetry.sinks.films import FilmsSink
from learner.telemetry.sinks.sink import Sink
from tests.epoch_rows import epoch_row
from tests.learner.telemetry.snapshots import snapshot
from tests.paths import ROOT
from tests.patience import PATIENCE, wait_until

FILMER = "tests.learner.telemetry.sinks.filmer"


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    folder = RunFolder(tmp_path, "r")
    folder.snapshots.mkdir(parents=True)
    for epoch in range(1, 5):
        (folder.snapshots / f"epoch-{epoch:04d}.safetensors").write_text(f"network {epoch}")
    return folder


def end_epoch(films: FilmsSink, epoch: int, phase: str = "train") -> None:
    films.phase(epoch_row((1.0,), epoch=epoch, phase=phase), 1_000 * epoch)


class Shows(Sink):
    """Takes films."""

    def __init__(self) -> None:
        self.films: list[tuple[str, str, int]] = []

    def filmed(self, file: Path, agent_steps: int) -> None:
        self.films.append((file.name, file.read_text(), agent_steps))


class Blind(Sink):
    """Cannot read films."""

    def filmed(self, file: Path, agent_steps: int) -> None:
        int("no film")


def end_film(films: FilmsSink) -> None:
    assert films._child is not None
    films._child.wait(PATIENCE)


def make_film(films: FilmsSink) -> None:
    """Has the film that is due made, and closes the sink."""
    films.write(snapshot({}))
    end_film(films)
    films.close()


def told(folder: RunFolder) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.films.glob("*.mp4")}


def test_one_epoch_after_the_other_and_none_twice(folder: RunFolder) -> None:
    other = Shows()
    films = FilmsSink(folder, 2.5, 1.0, FILMER, [other])
    films.write(snapshot({}))
    assert not folder.films.exists()
    end_epoch(films, 1)
    films.write(snapshot({}))
    end_epoch(films, 1, "test")
    end_film(films)
    assert told(folder) == {}  # until it is complete
    films.write(snapshot({}))
    assert told(folder) == {"epoch-0001.mp4": "film network 1 2.5"}
    films.write(snapshot({}))
    assert films._child is None
    films.close()
    assert other.films == [("epoch-0001.mp4", "film network 1 2.5", 1_000)]


def test_the_first_film_is_of_random_play(folder: RunFolder) -> None:
    other = Shows()
    folder.checkpoint.write_text("the first weights")
    films = FilmsSink(folder, 2.5, 1.0, FILMER, [other])
    films.start(None)
    films.phase(epoch_row((-21.0,), epoch=0, phase="random"), 600)
    films.write(snapshot({}))
    end_epoch(films, 1)
    for _ in range(2):
        end_film(films)
        films.write(snapshot({}))
    assert other.films == [
        ("epoch-0000.mp4", "film the first weights 2.5 1", 600),
        ("epoch-0001.mp4", "film network 1 2.5", 1_000),
    ]
    assert told(folder).keys() == {"epoch-0000.mp4", "epoch-0001.mp4"}


@pytest.mark.parametrize("given", [True, False])
def test_the_film_of_the_warm_up_is_of_the_network_that_was_given_or_of_random_play(
    folder: RunFolder, given: bool
) -> None:
    folder.checkpoint.write_text("weights that have learned")
    if given:
        folder.initial.write_text("given weights")
    films = FilmsSink(folder, 1.0, 0.05, FILMER)
    end_epoch(films, 0)
    make_film(films)
    words = "given weights 1 0.05" if given else "weights that have learned 1 1"
    assert told(folder) == {"epoch-0000.mp4": f"film {words}"}


def test_a_run_that_is_resumed_in_its_first_epoch_has_the_film_of_random_play(
    folder: RunFolder,
) -> None:
    shutil.rmtree(folder.snapshots)
    folder.checkpoint.write_text("weights")
    in_warm_up = FilmsSink(folder, 1.0, 1.0, FILMER)
    in_warm_up.start(300)
    in_warm_up.write(snapshot({}))
    assert in_warm_up._child is None
    EpochTable(folder.epochs).append(epoch_row((-21.0,), epoch=0, phase="random"))
    films = FilmsSink(folder, 1.0, 1.0, FILMER)
    films.start(700)
    make_film(films)
    assert told(folder).keys() == {"epoch-0000.mp4"}


def test_a_run_without_snapshots_is_not_filmed_as_if_it_played_at_random(folder: RunFolder) -> None:
    shutil.rmtree(folder.snapshots)
    folder.checkpoint.write_text("weights that have learned")
    for epoch, phase in ((0, "random"), (1, "train")):
        EpochTable(folder.epochs).append(epoch_row((-21.0,), epoch=epoch, phase=phase))
    films = FilmsSink(folder, 1.0, 0.1, FILMER)
    films.start(700)
    films.write(snapshot({}))
    assert films._child is None


def test_a_film_that_cannot_be_read_costs_nobody_else_anything(
    folder: RunFolder, caplog: pytest.LogCaptureFixture
) -> None:
    other = Shows()
    films = FilmsSink(folder, 1.0, 1.0, FILMER, [Blind(), other])
    end_epoch(films, 1)
    films.write(snapshot({}))
    end_film(films)
    films.write(snapshot({}))
    (told,) = [each.getMessage() for each in caplog.records]
    assert told.startswith("the film of epoch 1 is not shown: invalid literal")
    assert [name for name, *_ in other.films] == ["epoch-0001.mp4"]


def test_epochs_that_pass_meanwhile_are_left_out(folder: RunFolder) -> None:
    films = FilmsSink(folder, 1.0, 1.0, FILMER)
    end_epoch(films, 1)
    films.write(snapshot({}))
    end_epoch(films, 3)
    end_epoch(films, 4)
    end_film(films)
    films.write(snapshot({}))
    end_film(films)
    films.write(snapshot({}))
    assert told(folder).keys() == {"epoch-0001.mp4", "epoch-0004.mp4"}


def test_a_film_that_fails_is_told_and_the_next_is_made(
    folder: RunFolder, caplog: pytest.LogCaptureFixture
) -> None:
    other = Shows()
    films = FilmsSink(folder, 1.0, 1.0, FILMER, [other])
    end_epoch(films, 2)
    films.write(snapshot({}))
    end_epoch(films, 4)
    end_film(films)
    films.write(snapshot({}))
    assert [each.getMessage() for each in caplog.records] == [
        "there is no film of epoch 2: no picture"
    ]
    end_film(films)
    films.write(snapshot({}))
    assert told(folder).keys() == {"epoch-0004.mp4"}
    assert [name for name, *_ in other.films] == ["epoch-0004.mp4"]


def test_a_disk_without_room_is_told(folder: RunFolder, caplog: pytest.LogCaptureFixture) -> None:
    folder.films.write_text("no folder")
    films = FilmsSink(folder, 1.0, 1.0)
    end_epoch(films, 1)
    films.write(snapshot({}))
    films.write(snapshot({}))
    assert [each.getMessage()[:27] for each in caplog.records] == ["there is no film of epoch 1"]


def test_the_end_of_the_run_breaks_a_film_off(
    folder: RunFolder, caplog: pytest.LogCaptureFixture
) -> None:
    films = FilmsSink(folder, 1.0, 1.0, FILMER)
    end_epoch(films, 3)
    films.write(snapshot({}))
    half = folder.films / "making" / "epoch-0003.mp4"
    wait_until(half.exists, "the film is being made")
    filmer = films._child
    assert filmer is not None
    films.close()
    assert filmer.returncode == -signal.SIGKILL  # nobody waits for a film that is not kept
    assert not folder.films.exists()
    (told,) = [each.getMessage() for each in caplog.records]
    assert told.startswith("the film of epoch 3 was interrupted: make one by `ale-robot film ")


def test_a_film_that_is_made_at_the_end_is_kept(folder: RunFolder) -> None:
    other = Shows()
    films = FilmsSink(folder, 1.0, 1.0, FILMER, [other])
    end_epoch(films, 1)
    make_film(films)
    assert [path.name for path in folder.films.iterdir()] == ["epoch-0001.mp4"]
    assert len(other.films) == 1


def test_a_film_that_ends_with_the_run_on_a_disk_that_fails_is_told(
    folder: RunFolder, caplog: pytest.LogCaptureFixture
) -> None:
    films = FilmsSink(folder, 1.0, 1.0, FILMER)
    end_epoch(films, 1)
    films.write(snapshot({}))
    end_film(films)
    shutil.rmtree(folder.films)
    films.close()
    assert [each.getMessage()[:29] for each in caplog.records] == ["there is no film of epoch 1: "]


def test_a_resumed_run_films_its_newest_epoch(folder: RunFolder) -> None:
    for resumed, expected in ((1_000, {"epoch-0004.mp4"}), (2_000, {"epoch-0004.mp4"})):
        making = folder.films / "making"
        making.mkdir(parents=True)
        (making / "epoch-0001.mp4").touch()  # of a learner that was killed
        other = Shows()
        films = FilmsSink(folder, 1.0, 1.0, FILMER, [other])
        films.start(resumed)
        films.write(snapshot({}))
        if resumed == 1_000:
            end_film(films)
            films.write(snapshot({}))
        assert films._child is None
        assert told(folder).keys() == expected
        assert [steps for *_, steps in other.films] == ([1_000] if resumed == 1_000 else [])
        films.close()
        shutil.rmtree(making, ignore_errors=True)


@pytest.mark.usefixtures("forks")
def test_the_real_films(folder: RunFolder) -> None:
    for network in (folder.checkpoint, folder.snapshots / "epoch-0001.safetensors"):
        for suffix in (".safetensors", ".json"):
            policy = ROOT / "policies" / f"ale_pong{suffix}"
            shutil.copy(policy, network.with_suffix(suffix))
    films = FilmsSink(folder, 1.0, 1.0)
    for epoch, phase in enumerate(("random", "train")):
        end_epoch(films, epoch, phase)
        films.write(snapshot({}))
        end_film(films)
        films.write(snapshot({}))
    pictures = []
    for epoch in range(2):
        with av.open(str(folder.films / f"epoch-{epoch:04d}.mp4")) as film:
            shown = [frame.to_ndarray(format="gray") for frame in film.decode(video=0)]
        assert len(shown) == 15  # decisions of a second
        pictures.append(shown[-1])
    # Bars and numbers of the Q-values of six actions; random play has none.
    random, network = ((picture[104:236, 900:] > 60).mean() for picture in pictures)
    assert random < 0.01 < 0.05 < network

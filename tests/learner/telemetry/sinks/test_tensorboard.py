"""Curves, read back with TensorBoard's own reader."""

import io
import os
import subprocess
import sys
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.backend.event_processing.plugin_event_multiplexer import EventMultiplexer
from tensorboard.plugins.custom_scalar import metadata as custom_scalars
from tensorboard.plugins.custom_scalar.layout_pb2 import Layout
from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData

from common.metrics import METRICS, Value
from common.protocol.actor_stats import ActorStats
from common.protocol.live_view import LiveView, ViewRequest, size_of
from common.run.epochs import EpochRow
from learner.telemetry.live_feed import Asked
from learner.telemetry.sinks.tensorboard import TensorBoardSink
from learner.telemetry.snapshot import ActorView, Histogram
from tests.common.protocol.test_live_view import VIEW
from tests.full_disk import let_the_disk_take
from tests.learner.telemetry.sinks.small_film import write_film
from tests.learner.telemetry.snapshots import changed, snapshot

STATUS = snapshot(
    {
        "run/agent_steps": 1_000,
        "learning/epsilon": 0.5,
        "learning/updates": 125,
        "learning/loss": 0.25,
        "stream/chunks_made": 17,
        "stream/chunks_acked": 15,
        "stream/chunks_refused": 1,
        "stream/actors_alive": 1,
        "play/valid_frame_share": 0.5,
        "learning/held_out_std": None,
        "hands/press_p50": 50.0,
        "hands/release_p50": 16.5,
        "hands/release_p99": 33.5,
        "gates/failed": 1,
    }
)
ROW = EpochRow(
    epoch=1,
    phase="test",
    steps=12_500,
    nr_games=10,
    average_reward=-20.5,
    min_game_reward=-21.0,
    max_game_reward=-19.0,
    last_exploration_rate=0.05,
    total_train_steps=25_000,
    replay_memory_count=25_500,
    meanq=0.75,
    meancost=0.0,
    weight_updates=6_250,
    total_time=100.0,
    epoch_time=25.0,
    steps_per_second=500.0,
)


def started(folder: Path, resumed_at: int | None = None) -> TensorBoardSink:
    curves = TensorBoardSink(folder, {"env": "ale", "learning.n_step": 5, "learning.double": True})
    curves.start(resumed_at)
    return curves


def read(folder: Path) -> dict[str, list[tuple[int, float]]]:
    events = EventAccumulator(str(folder))
    events.Reload()
    return {
        tag: [(point.step, point.value) for point in events.Scalars(tag)]
        for tag in events.Tags()["scalars"]
    }


def test_status_and_epochs_over_agent_steps(tmp_path: Path) -> None:
    curves = started(tmp_path)
    curves.write(STATUS)
    curves.write(changed(STATUS, {"run/agent_steps": 2_000, "learning/loss": 0.125}))
    curves.phase(ROW, 25_500)
    curves.close()
    points = read(tmp_path)
    assert points["learning/loss"] == [(1_000, 0.25), (2_000, 0.125)]
    assert points["gates/refused_chunks"] == points["stream/chunks_refused"]
    assert points["learning/updates"] == [(1_000, 125), (2_000, 125)]
    assert points["stream/chunks_made"][0] == (1_000, 17)
    assert points["stream/actors_alive"][0] == (1_000, 1)
    assert points["gates/valid_frames"][0] == (1_000, 0.5)
    assert points["gates/failed"][0] == (1_000, 1)
    assert points["gates/press_p50_ms"][0] == (1_000, 50.0)
    assert "gates/press_p99_ms" not in points  # not measured
    assert points["gates/release_p50_ms"][0] == (1_000, 16.5)
    assert points["gates/release_p99_ms"][0] == (1_000, 33.5)
    assert points["play/epoch_test_reward"] == [(25_500, -20.5)]
    assert points["learning/epoch_test_mean_max_q"] == [(25_500, 0.75)]
    assert {tag.split("/")[0] for tag in points} == {"play", "learning", "stream", "gates"}


def test_what_a_full_disk_refused_follows_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    curves = started(tmp_path)
    with monkeypatch.context() as patched:
        let_the_disk_take(patched, 3, 100)
        with pytest.raises(OSError, match="No space"):
            curves.write(STATUS)
    curves.write(changed(STATUS, {"run/agent_steps": 2_000, "learning/loss": 0.125}))
    curves.close()
    assert read(tmp_path)["learning/loss"] == [(1_000, 0.25), (2_000, 0.125)]


def test_after_a_full_disk_no_point_is_written_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The telemetry repeats a write that failed."""
    curves = started(tmp_path)
    with monkeypatch.context() as patched:
        let_the_disk_take(patched, 3)
        for _ in range(3):
            with pytest.raises(OSError, match="No space"):
                curves.write(STATUS)
    curves.write(changed(STATUS, {"run/agent_steps": 2_000}))
    curves.close()
    assert read(tmp_path)["learning/loss"] == [(1_000, 0.25), (2_000, 0.25)]


def test_the_figures_of_a_phase_are_in_the_file_at_once_unless_the_disk_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after kill -9: nobody closes the file."""
    curves = started(tmp_path)
    curves.phase(ROW, 25_500)
    assert read(tmp_path)["play/epoch_test_reward"] == [(25_500, -20.5)]
    with monkeypatch.context() as patched:
        let_the_disk_take(patched, 3)
        curves.phase(ROW, 26_000)
    curves.write(STATUS)
    assert read(tmp_path)["play/epoch_test_reward"] == [(25_500, -20.5), (26_000, -20.5)]
    curves.close()


def test_the_file_is_closed_on_a_full_disk_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    curves = started(tmp_path)
    curves.add({"learning/loss": 0.5}, 1_000)
    file = curves._file._file
    with monkeypatch.context() as patched:
        let_the_disk_take(patched)
        with pytest.raises(OSError, match="No space"):
            curves.close()
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(file)


def test_the_unknown_has_no_point(tmp_path: Path) -> None:
    curves = started(tmp_path)
    curves.write(STATUS)
    curves.phase(replace(ROW, average_reward=None), 25_500)
    curves.close()
    points = read(tmp_path)
    assert "learning/mean_max_q" not in points
    assert "gates/max-Q_deviation" not in points
    assert "play/epoch_test_reward" not in points


def test_resume_drops_what_came_after_the_checkpoint(tmp_path: Path) -> None:
    curves = started(tmp_path)
    for steps, loss in ((1_000, 4.0), (2_000, 2.0), (3_000, 1.0)):
        curves.write(changed(STATUS, {"run/agent_steps": steps, "learning/loss": loss}))
    curves.close()
    curves = started(tmp_path, resumed_at=2_000)
    curves.write(changed(STATUS, {"run/agent_steps": 2_500, "learning/loss": 8.0}))
    curves.close()
    assert read(tmp_path)["learning/loss"] == [(1_000, 4.0), (2_000, 2.0), (2_500, 8.0)]


def test_settings_and_layout_are_there_once(tmp_path: Path) -> None:
    started(tmp_path).close()
    started(tmp_path, resumed_at=2_000).close()
    plugins = EventMultiplexer().AddRunsFromDirectory(str(tmp_path)).Reload()
    [run] = plugins.Runs()
    [(_, content)] = plugins.PluginRunToTagToContent("hparams")[run].items()
    settings = HParamsPluginData.FromString(content).session_start_info.hparams
    assert settings["env"].string_value == "ale"
    assert settings["learning.n_step"].number_value == 5
    assert settings["learning.double"].bool_value is True
    [event] = plugins.Tensors(run, custom_scalars.CONFIG_SUMMARY_TAG)
    layout = Layout.FromString(event.tensor_proto.string_val[0])
    assert layout.category[0].title == "Score"
    tags = {tag for each in layout.category for chart in each.chart for tag in chart.multiline.tag}
    curves = {metric.key for metric in METRICS.values() if metric.curve}
    assert tags - curves == {"play/epoch_train_reward", "play/epoch_test_reward"}


def test_histograms(tmp_path: Path) -> None:
    curves = started(tmp_path)
    curves.write(
        changed(STATUS, {}, histograms={"hands/press_ms": Histogram([3, 0, 1], [0, 10, 20, 40])})
    )
    curves.close()
    events = EventAccumulator(str(tmp_path))
    events.Reload()
    [event] = events.Histograms("hands/press_ms")
    shown = event.histogram_value
    assert (event.step, shown.min, shown.max, shown.num) == (1_000, 0, 40, 4)
    assert (shown.sum, shown.sum_squares) == (3 * 5 + 30, 3 * 25 + 900)
    assert (shown.bucket_limit, shown.bucket) == ([10, 20, 40], [3, 0, 1])


def test_a_film_is_a_gif_of_its_beginning(tmp_path: Path) -> None:
    curves = started(tmp_path)
    curves.filmed(write_film(tmp_path / "film.mp4", pictures=3 * 60), 25_500)
    curves.close()
    events = EventAccumulator(str(tmp_path))
    events.Reload()
    (image,) = events.Images("play/film")
    assert (image.step, image.width, image.height) == (25_500, 512, 384)
    with Image.open(io.BytesIO(image.encoded_image_string)) as shown:
        assert (shown.format, shown.size) == ("GIF", (512, 384))
        assert (getattr(shown, "n_frames", 1), shown.info["duration"]) == (40, 200)
        first = np.asarray(shown.convert("L")).mean()
        shown.seek(39)
        # Every third of fifteen pictures a second, of 180 that grow brighter.
        assert np.asarray(shown.convert("L")).mean() - first == pytest.approx(165, abs=5)


class Feed:
    """Answers when the test says so."""

    def __init__(self) -> None:
        self.asked: list[Asked] = []
        self.answers: list[Future[LiveView | None]] = []

    def begin(self, asked: Asked) -> Future[LiveView | None]:
        self.asked.append(asked)
        self.answers.append(Future())
        return self.answers[-1]


def test_now_and_then_it_shows_what_an_actor_sees(tmp_path: Path) -> None:
    seconds = [0.0]
    feed = Feed()
    curves = TensorBoardSink(tmp_path, {}, lambda: seconds[0])
    curves.watch(feed)  # type: ignore[arg-type]
    curves.start(None)
    curves.write(STATUS)
    assert not feed.asked  # nobody is there
    evaluator = ActorView(stats=ActorStats("e", "evaluator"), alive=True)
    lost = ActorView(stats=ActorStats("a", "actor"), alive=False)
    actor = ActorView(stats=ActorStats("b", "actor"), alive=True)
    answers: list[tuple[int, int, LiveView | Exception | None]] = [
        (1_000, 0, VIEW),
        (2_000, 10, None),
        (3_000, 300, OSError("gone")),
        (4_000, 300, VIEW),
        (5_000, 10, None),
    ]
    for steps, wait, answer in answers:
        seconds[0] += wait
        values: dict[str, Value] = {"run/agent_steps": steps}
        asked = len(feed.asked)
        curves.write(changed(STATUS, values, actors=(evaluator, lost, actor)))
        for each in feed.answers[asked:]:
            curves.write(changed(STATUS, {"run/agent_steps": steps + 10}, actors=(actor,)))
            if isinstance(answer, Exception):
                each.set_exception(answer)
            else:
                each.set_result(answer)
    curves.close()
    assert feed.asked == [Asked("actor", "b", ViewRequest())] * 3
    events = EventAccumulator(str(tmp_path))
    events.Reload()
    images = events.Images("play/camera")
    assert [(each.step, each.width, each.height) for each in images] == [
        (1_000, *size_of(VIEW.picture)),
        (4_000, *size_of(VIEW.picture)),
    ]
    assert images[0].encoded_image_string == VIEW.picture


def test_import_is_light_and_silent() -> None:
    code = "import sys, learner.telemetry.sinks.tensorboard; assert 'torch' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")

"""The run's curves for TensorBoard, over agent steps, with settings, histograms, pictures, films.

PyTorch's own writer takes seconds to import, and offers nothing more that is needed here.
"""

import io
import logging
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from contextlib import suppress
from itertools import islice
from pathlib import Path

import av
from PIL.Image import Quantize, fromarray
from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import HistogramProto, Summary
from tensorboard.compat.proto.tensor_pb2 import TensorProto
from tensorboard.compat.proto.types_pb2 import DT_STRING
from tensorboard.plugins.custom_scalar import layout_pb2
from tensorboard.plugins.custom_scalar import metadata as custom_scalars
from tensorboard.plugins.hparams.summary_v2 import hparams_pb

from common.metrics import METRICS, Value, Values
from common.protocol.live_view import LiveView, ViewRequest, size_of
from common.run.epochs import EpochRow
from common.schedule import Every, Now
from learner.telemetry.live_feed import Asked, LiveFeed
from learner.telemetry.sinks.curves import FILM, CurvesSink, tags_of
from learner.telemetry.sinks.event_file import EventFile
from learner.telemetry.snapshot import Histogram, Snapshot

_PICTURE_SECONDS = 300.0
_FILM_RATE, _FILM_PICTURES, _FILM_WIDTH = 5, 40, 512
"""The GIF of a film: pictures per second, maximum number of pictures, width in pixels."""
_LAYOUT: dict[str, dict[str, list[str]]] = {
    "Score": {"score": ["play/train_reward", "play/epoch_train_reward", "play/epoch_test_reward"]},
    "Learning": {
        "loss": ["learning/loss"],
        "max-Q": ["learning/mean_max_q"],
        "learning rate": ["learning/rate"],
    },
    "Speed": {
        "agent steps per second": ["stream/steps_per_second"],
        "updates per second": ["learning/updates_per_second"],
    },
}
"""Curves by chart by group on TensorBoard's page "Custom Scalars", which shows the main ones."""


class TensorBoardSink(CurvesSink):
    """Writes event files to ``folder``; earlier files in it stay.

    Args:
        settings: the run's settings, by names such as ``learning.n_step``.
    """

    def __init__(self, folder: Path, settings: Values, now: Now = time.monotonic) -> None:
        self._folder = folder
        self._settings = settings
        self._feed: LiveFeed | None = None
        self._asked: tuple[int, Future[LiveView | None]] | None = None
        """The picture that is on its way, if any, and the agent steps when it was asked for."""
        self._pictures = Every(_PICTURE_SECONDS, now)

    def watch(self, feed: LiveFeed) -> None:
        self._feed = feed

    def start(self, resumed_at: int | None) -> None:
        """Opens a file; TensorBoard drops the points after ``resumed_at``."""
        self._file = EventFile(self._folder)
        if resumed_at is None:
            # TensorBoard's page "HParams" takes the run's settings from `hparams_pb`.
            self._add([*hparams_pb(self._settings).value, _layout()], 0)
        else:
            restart = SessionLog(status=SessionLog.START)
            event = Event(wall_time=time.time(), step=resumed_at + 1, session_log=restart)
            self._file.add(event)
        self._file.flush()

    def close(self) -> None:
        self._file.close()

    def write(self, snapshot: Snapshot) -> None:
        """Writes what `CurvesSink.write` does, and from time to time an actor's camera picture."""
        self._file.flush()  # if the disk is still full, this fails before points are added twice
        super().write(snapshot)
        self._add_picture(snapshot, int(snapshot.values.get("run/agent_steps") or 0))
        self._file.flush()

    def phase(self, row: EpochRow, agent_steps: int) -> None:
        super().phase(row, agent_steps)
        with suppress(OSError):  # the next `write` tries again
            self._file.flush()  # before a checkpoint counts the row, which is not told again

    def filmed(self, file: Path, agent_steps: int) -> None:
        # TensorBoard shows a GIF among its images.
        self._add([_gif(file)], agent_steps)

    def _add_picture(self, snapshot: Snapshot, agent_steps: int) -> None:
        if self._feed is None:
            return
        if self._asked is not None and self._asked[1].done():
            (asked_at, answer), self._asked = self._asked, None
            view = None if answer.exception() else answer.result()
            if view is not None and (jpeg := view.picture or view.frame):
                width, height = size_of(jpeg)
                image = Summary.Image(encoded_image_string=jpeg, width=width, height=height)
                self._add([Summary.Value(tag="play/camera", image=image)], asked_at)
        playing = (each for each in snapshot.present if each.alive and each.stats.role == "actor")
        if (actor := next(playing, None)) is not None and self._pictures.is_due():
            view_of = Asked("actor", actor.stats.name, ViewRequest())
            self._asked = agent_steps, self._feed.begin(view_of)

    def add(self, points: Values, agent_steps: int) -> None:
        known = {tag: value for tag, value in points.items() if value is not None}
        self._add([Summary.Value(tag=t, simple_value=v) for t, v in known.items()], agent_steps)

    def add_histograms(self, found: Mapping[str, Histogram], agent_steps: int) -> None:
        self._add([_histogram(*each) for each in found.items()], agent_steps)

    def _add(self, values: list[Summary.Value], agent_steps: int) -> None:
        summary = Summary(value=values)
        self._file.add(Event(wall_time=time.time(), step=agent_steps, summary=summary))


def written_points(folder: Path) -> Iterator[Values]:
    """Yields the points of the live curves in the event files of ``folder``, oldest first.

    Each has its ``run/agent_steps``. Without the folder there are no points.
    """
    if not folder.is_dir():
        return
    # This import takes long, and only a resumed run needs it.
    from tensorboard.backend.event_processing.event_accumulator import SCALARS, EventAccumulator

    # A resumed run writes again the steps after its checkpoint, of which the reader would warn.
    logging.getLogger("tensorboard").setLevel(logging.ERROR)
    events = EventAccumulator(str(folder), size_guidance={SCALARS: 0})  # 0: all of them
    events.Reload()
    found: dict[int, dict[str, Value]] = {}
    for metric in METRICS.values():
        for tag in tags_of(metric)[:1]:
            for point in events.Scalars(tag) if tag in events.Tags()[SCALARS] else ():
                found.setdefault(point.step, {})[metric.key] = point.value
    for steps, values in sorted(found.items()):
        yield {**values, "run/agent_steps": steps}


def _layout() -> Summary.Value:
    layout = layout_pb2.Layout()
    for group, charts in _LAYOUT.items():
        category = layout.category.add(title=group)
        for title, tags in charts.items():
            category.chart.add(title=title, multiline={"tag": tags})
    return Summary.Value(
        tag=custom_scalars.CONFIG_SUMMARY_TAG,
        metadata=custom_scalars.create_summary_metadata(),
        tensor=TensorProto(dtype=DT_STRING, string_val=[layout.SerializeToString()]),
    )


def _histogram(name: str, found: Histogram) -> Summary.Value:
    """Returns a histogram; its sums assume that values lie in the middle of their bins."""
    middles = [(low + high) / 2 for low, high in zip(found.edges, found.edges[1:], strict=False)]
    weighted = list(zip(found.counts, middles, strict=True))
    proto = HistogramProto(
        min=found.edges[0],
        max=found.edges[-1],
        num=sum(found.counts),
        sum=sum(count * middle for count, middle in weighted),
        sum_squares=sum(count * middle**2 for count, middle in weighted),
        bucket_limit=found.edges[1:],
        bucket=found.counts,
    )
    return Summary.Value(tag=name, histo=proto)


def _gif(file: Path) -> Summary.Value:
    """Returns the beginning of a film, as a GIF."""
    with av.open(str(file.absolute())) as film:
        stream = film.streams.video[0]
        width, height = _FILM_WIDTH, round(_FILM_WIDTH / stream.width * stream.height)
        every = max(round((stream.average_rate or _FILM_RATE) / _FILM_RATE), 1)
        shown = islice(film.decode(stream), 0, every * _FILM_PICTURES, every)
        first, *others = [
            # This method is thirty times as fast as Pillow's default.
            fromarray(each.to_ndarray(width=width, height=height, format="rgb24")).quantize(
                method=Quantize.FASTOCTREE
            )
            for each in shown
        ]
    content = io.BytesIO()
    pause = 1000 // _FILM_RATE
    first.save(content, "GIF", save_all=True, append_images=others, duration=pause, loop=0)
    image = Summary.Image(encoded_image_string=content.getvalue(), width=width, height=height)
    return Summary.Value(tag=FILM, image=image)

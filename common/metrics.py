"""Every figure of a run, declared once: what it means, how it is written, and where it is shown.

The code that knows a figure puts it into a mapping of key to value. The learner merges these
mappings and gives the result to every sink, which shows what this table tells it to. A new figure
is one line here and the line that computes it. The actors' counters declare their totals
themselves, in `common.protocol.actor_stats`.
"""

import operator
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from common.press_latency import ms_of
from common.protocol.actor_stats import COUNTERS

Value = float | int | str | None
"""None while the value is unknown."""
Values = Mapping[str, Value]
Unit = Literal[
    "none", "bytes", "chunks", "commands", "connections", "cores", "epochs", "frames", "games",
    "grey levels", "milliseconds", "per day", "per second", "points", "processes", "ratio",
    "seconds", "steps", "updates",
]  # fmt: skip
"""``none`` is for a figure without a unit: a text, a loss, a Q-value."""

_HOLDS = {
    "≥": operator.ge,
    ">": operator.gt,
    "<": operator.lt,
    "≤": operator.le,
    "=": operator.eq,
}


@dataclass(frozen=True)
class Bound:
    """A health check: a bound on a figure, without which learning cannot be trusted."""

    check: str
    """Name of the health check."""
    sign: Literal["≥", ">", "<", "≤", "="]
    limit: float
    why: str
    """What a failure means, in one line."""
    stops: bool = True
    """Whether a run in which it keeps failing ends itself; see `learner.health_guard`."""
    quiet: bool = False
    """Whether the check is listed only when it fails."""
    who: str = ""
    """Key of the figure that names who is at fault."""

    def admits(self, value: float) -> bool:
        """Whether ``value`` is within the bound; NaN never is."""
        return bool(_HOLDS[self.sign](value, self.limit))

    def __str__(self) -> str:
        return f"{self.sign} {self.limit:.4g}"


VALID_FRAMES = Bound("valid frames", "≥", 0.99, "the screen is not found in the camera's picture")
FOLLOWING_FRAMES = Bound(
    "following frames", "≥", 0.5, "frames do not change as the game does", quiet=True
)
PIXEL_DEVIATION = Bound("pixel deviation", ">", 1.0, "frames are black or of one grey")
KEYS_AS_COMMANDED = Bound(
    "keys as commanded", "≥", 0.5, "the hands do not press the commanded keys"
)
PRESS_MS = Bound(
    "press p99 ms", "≤", ms_of(8), "the hands press the commanded keys too late", stops=False
)
"""The limit is two agent steps, the goal of `python -m benchmarks.lab.press_latency`."""


@dataclass(frozen=True)
class Metric:
    """One figure. Keys in braces in ``label``, ``shown`` and ``line`` stand for figures, written in
    their forms."""

    key: str
    """Its name everywhere, as ``group/name``."""
    unit: Unit
    form: str
    """How it is written for people: a name in `learner.telemetry.formats.FORMS`."""
    meaning: str
    """One sentence, without a full stop."""
    label: str = ""
    """Short name for the screen."""
    panel: tuple[str, int] | None = None
    """Its panel on the screen, and its place there; a small terminal shows six of each panel."""
    shown: str = ""
    """The text beside the label, if it is more than the figure."""
    line: str = ""
    """Its words in a line of the log."""
    robot: bool = False
    """Whether it is shown and checked only if a robot plays, because an emulator has no hands."""
    curve: bool = False
    """Whether TensorBoard draws it, under its key."""
    gate: str = ""
    """Its column in ``gates.csv``, and its curve under ``gates/``."""
    summary: str = ""
    """Its key in ``summary.json``; a dot leads into an inner object."""
    bound: Bound | None = None
    """The health check that judges it."""
    counter: bool = False
    """Whether it only grows while a process lives, so that Prometheus can take its rate."""
    trouble: str = ""
    """Word for it behind the number of actors, where it appears once the figure is above 0."""


METRICS: dict[str, Metric] = {}
"""All declared figures by key, in the order of declaration."""


def declare(*metrics: Metric) -> None:
    """Adds figures to the table.

    Raises ValueError if a key, a column or a summary key is taken, or a meaning is missing.
    """
    for metric in metrics:
        if not metric.meaning or "/" not in metric.key:
            raise ValueError(f"{metric.key!r} needs a meaning, and a key like group/name")
        for name in ("key", "gate", "summary"):
            value = getattr(metric, name)
            if value and any(getattr(other, name) == value for other in METRICS.values()):
                raise ValueError(f"{name} {value!r} of {metric.key!r} is declared already")
        METRICS[metric.key] = metric


def number(values: Values, key: str) -> float | None:
    """Returns the figure ``key`` as a number; None while it is unknown."""
    value = values.get(key)
    return None if isinstance(value, str) else value


# fmt: off
_OF_LATENCY: tuple[tuple[str, Unit, str, str], ...] = (
    ("measured", "commands", "count", "Commands for which the time was measured until"),
    ("p50", "milliseconds", "ms", "Median time until"),
    ("p99", "milliseconds", "ms", "99th percentile of the time until"),
    ("watched", "milliseconds", "ms", "Longest time that a command was watched until"),
    ("given_up", "ratio", ".3", "Share of the commands that were given up before"),
)
declare(
    Metric("run/run", "none", "text", "Name of the run", summary="run"),
    Metric("run/preset", "none", "text", "Preset of the run's settings", summary="preset"),
    Metric("run/env", "none", "text", "Who plays: the emulator alone, or a robot", summary="env"),
    Metric("run/game", "none", "text", "Atari game, or the environment itself if it has none",
           summary="game"),
    Metric("run/seed", "none", "count", "Seed of the run", summary="seed"),
    Metric("run/initial", "none", "text", "Network that the run began with, and its SHA-256",
           summary="initial"),
    Metric("run/demonstrations", "steps", "count", "Recorded steps with which the replay began",
           summary="demonstrations"),
    Metric("run/sync", "none", "text", "Whether the world waits for the agent, in local mode",
           summary="sync"),
    Metric("run/wait_action", "none", "text",
           "Whether a step lasts until the keys are as commanded, in local mode",
           summary="wait_action"),
    Metric("run/speed", "ratio", "plain",
           "Game seconds per second if the world does not wait, in local mode", summary="speed"),
    Metric("run/device", "none", "text", "Device of the updates", summary="device"),
    Metric("run/busy_cores", "cores", ".2", "Recent processor time per second of the learner"),
    Metric("run/memory_bytes", "bytes", "count", "Memory of the learner, without file pages"),
    Metric("run/gpu_memory_bytes", "bytes", "count",
           "Memory of the learner's GPU in use by all programs; with CUDA"),
    Metric("run/gpu_capacity_bytes", "bytes", "count", "Memory of the learner's GPU; with CUDA"),
    Metric("run/gpu_utilisation", "ratio", ".2",
           "Share of the last second, or less, in which the learner's GPU was busy; with CUDA "
           "and nvidia-ml-py"),
    Metric("run/join", "none", "text", "Command that starts an actor, if the learner starts none"),
    Metric("run/page", "none", "text", "Address of the run's page, with --web"),
    Metric("run/phase", "none", "text", "Warm-up, training, or finishing"),
    Metric("run/seconds", "seconds", "duration",
           "Wall-clock time of work on this run, including that before a resume",
           summary="wall_seconds"),
    Metric("run/seconds_left", "seconds", "duration", "Time to the end of the current phase"),
    Metric("run/agent_steps", "steps", "count", "Agent steps of all actors, including the warm-up",
           line="{run/agent_steps} steps", summary="agent_steps", counter=True),
    Metric("run/steps_goal", "steps", "count", "Agent steps after which the run ends by itself"),
    Metric("run/seconds_to_goal", "seconds", "duration",
           "Time until the run ends by itself, at the present rate"),
    Metric("run/epoch", "epochs", "count", "Current epoch of training; 0 during the warm-up",
           summary="epoch"),
    Metric("run/phase_steps", "steps", "count", "Agent steps so far in the current phase"),
    Metric("run/phase_length", "steps", "count", "Agent steps of the current phase in all"),
    Metric("run/train_steps_per_second", "per second", ".1",
           "Agent steps per second over all finished training phases; over the last 15 s before "
           "the first has ended", summary="steps_per_second"),
    Metric("run/test_steps_per_second", "per second", ".1",
           "Agent steps per second over all finished tests", summary="test_steps_per_second"),
    Metric("run/epochs_per_day", "per day", ".1",
           "Epochs of 2017, each training and then a test, that fit in a day at this run's rates",
           summary="epochs_per_day"),

    Metric("play/test_reward", "points", ".2", "Mean score of the latest finished test",
           "test, epoch {play/test_epoch}", ("Reward", 1), summary="test_reward"),
    Metric("play/test_epoch", "epochs", "count", "Epoch whose snapshot the latest test played",
           summary="test_epoch"),
    Metric("play/train_reward", "points", ".2", "Mean score of the recent training games",
           "train", ("Reward", 2), curve=True, gate="train_reward", summary="train_reward",
           line="reward train {play/train_reward} test {play/test_reward} "
                "random {play/random_reward}"),
    Metric("play/random_reward", "points", ".2", "Mean score of the random policy",
           "random policy", ("Reward", 3), summary="random_reward"),
    Metric("play/games", "games", "count", "Training games that ended after the warm-up",
           "games", ("Reward", 4), curve=True, gate="games", summary="games", counter=True),
    Metric("play/difficulty", "ratio", ".3",
           "Share of their full widths that the ranges of --randomise have in the next game",
           curve=True, summary="difficulty"),
    Metric("play/best_test_reward", "points", ".2", "Best mean score of a test",
           "best test", ("Reward", 7), summary="best_test_reward"),
    Metric("play/valid_frame_share", "ratio", ".3",
           "Share of the recent steps whose frame showed the game",
           "frames valid", ("Learning", 8), gate="valid_frames", summary="valid_frame_share",
           bound=VALID_FRAMES),
    Metric("play/following_frame_share", "ratio", ".3",
           "Share of the recent steps whose frames changed as the game's own pictures did",
           gate="following_frames",
           bound=FOLLOWING_FRAMES),
    Metric("play/faulty_environments", "none", "count",
           "Environments of whose newest steps fewer than half saw the screen, saw it change, or "
           "ended with the commanded keys",
           bound=Bound("faulty environments", "=", 0,
                       "some robots see nothing new, or press no keys", stops=False, quiet=True,
                       who="play/faulty_actors")),
    Metric("play/faulty_actors", "none", "text", "Names of up to three actors that have them"),

    Metric("learning/pixel_deviation", "grey levels", "significant",
           "Standard deviation of a sampled frame's pixels, mean over the recent updates",
           gate="pixel_deviation", bound=PIXEL_DEVIATION),
    Metric("learning/mean_max_q", "none", ".3", "Mean of max-Q over the held-out states",
           "mean max-Q", ("Learning", 1), line="max-Q {learning/mean_max_q}", curve=True,
           summary="mean_max_q"),
    Metric("learning/held_out_std", "none", "significant",
           "Standard deviation of max-Q over the held-out states", "its deviation",
           ("Learning", 2), curve=True, gate="max-Q_deviation", summary="held_out_std",
           bound=Bound("max-Q deviation", ">", 1e-6,
                       "the network answers the same whatever it sees")),
    Metric("learning/recent_max_q_std", "none", "significant",
           "Standard deviation of max-Q over states of the newest steps",
           gate="recent_max-Q_deviation",
           bound=Bound("recent max-Q deviation", ">", 1e-6,
                       "the network answers the same to all that it saw recently", quiet=True)),
    Metric("learning/relative_td_error", "ratio", "significant",
           "Mean squared TD error of the recent minibatches, divided by the variance of the "
           "targets",
           gate="relative_TD_error",
           bound=Bound("relative TD error", "<", 1.0,
                       "the network predicts no better than one that sees nothing", stops=False)),
    Metric("learning/td_error_squared", "none", "significant",
           "Mean squared TD error in the recent minibatches"),
    Metric("learning/loss", "none", "significant", "Mean loss of the recent updates",
           "loss", ("Learning", 3), line="loss {learning/loss}", curve=True, summary="loss"),
    Metric("learning/updates", "updates", "count", "Updates of the network",
           "updates", ("Learning", 4), curve=True, summary="updates", counter=True),
    Metric("learning/skipped", "updates", "count",
           "Updates since the start that changed nothing because their loss was not finite",
           summary="skipped_updates",
           bound=Bound("skipped updates", "=", 0, "losses are not finite: see the log for whose "
                       "steps are at fault", stops=False, quiet=True), counter=True),
    Metric("learning/updates_per_second", "per second", ".1", "Recent updates per second",
           "updates/s", ("Learning", 5), line="{learning/updates_per_second} updates/s",
           curve=True, summary="updates_per_second"),
    Metric("learning/epsilon", "ratio", ".3", "Share of random actions in training",
           "exploration ε", ("Learning", 6), line="ε {learning/epsilon}", curve=True,
           summary="epsilon"),
    Metric("learning/rate", "none", "significant", "Learning rate of the next update", curve=True),

    Metric("play/press_match_share", "ratio", ".3",
           "Share of the recent steps that ended with exactly the commanded keys pressed",
           "keys matched", ("Reward", 8), robot=True, gate="keys_as_commanded",
           summary="press_match_share", bound=KEYS_AS_COMMANDED),
    Metric("hands/press_p99", "milliseconds", "ms",
           "99th percentile of the time until every key of a command is down, recently",
           robot=True, gate="press_p99_ms", bound=PRESS_MS),
    Metric("stream/chunks_refused", "chunks", "count", "Chunks that the replay refused",
           "refused", ("Stream", 8), curve=True, gate="refused_chunks", summary="chunks.refused",
           bound=Bound("refused chunks", "=", 0,
                       "actors send what the replay cannot accept; their logs say what",
                       stops=False), counter=True),
    Metric("hands/press_p50", "milliseconds", "ms",
           "Median time until every key of a command is down, recently",
           "press p50/99", ("Reward", 6), "{hands/press_p50}/{hands/press_p99} ms",
           "press {hands/press_p50}/{hands/press_p99} ms", robot=True, gate="press_p50_ms"),
    Metric("hands/release_p50", "milliseconds", "ms",
           "Median time until every key of the previous command is up, recently",
           "release p50/99", ("Reward", 5), "{hands/release_p50}/{hands/release_p99} ms",
           "release {hands/release_p50}/{hands/release_p99} ms", robot=True,
           gate="release_p50_ms"),
    Metric("hands/release_p99", "milliseconds", "ms",
           "99th percentile of the time until every key of the previous command is up, recently",
           robot=True, gate="release_p99_ms"),

    Metric("stream/steps_per_second", "per second", ".1", "Recent agent steps per second",
           "steps/s", ("Stream", 1), line="{stream/steps_per_second} steps/s", curve=True),
    Metric("stream/samples_per_insert", "ratio", ".2",
           "Steps sampled per step inserted after the warm-up", "samples/insert",
           ("Stream", 2), "{stream/samples_per_insert} → {stream/samples_per_insert_goal}",
           "{stream/samples_per_insert} samples/insert, target {stream/samples_per_insert_goal}",
           curve=True, summary="samples_per_insert"),
    Metric("stream/samples_per_insert_goal", "ratio", "plain",
           "Samples per insert at which the replay holds both sides",
           summary="samples_per_insert_goal"),
    Metric("stream/staleness_p50", "updates", ".0",
           "Median number of updates between a chunk's weights and the newest when it arrives",
           "stale p50/95", ("Stream", 3), "{stream/staleness_p50}/{stream/staleness_p95} upd.",
           "staleness {stream/staleness_p50}/{stream/staleness_p95} updates", curve=True,
           summary="staleness_updates.p50"),
    Metric("stream/staleness_p95", "updates", ".0",
           "95th percentile of the number of updates between a chunk's weights and the newest when "
           "it arrives",
           curve=True, summary="staleness_updates.p95"),
    Metric("stream/weights_version", "updates", "count",
           "Version of the newest published weights, a number of updates", "weights no.",
           ("Learning", 7),
           curve=True, summary="weights_version"),
    Metric("stream/chunks_acked", "chunks", "count", "Chunks that the replay accepted",
           "chunks acked", ("Stream", 4), curve=True, summary="chunks.acked", counter=True),
    Metric("stream/chunks_duplicate", "chunks", "count",
           "Chunks that arrived again and were not stored again", "duplicate", ("Stream", 6),
           curve=True, summary="chunks.duplicate", counter=True),
    Metric("stream/over_quota", "chunks", "count",
           "Chunks and polls that actors must send again: over quota, or of those that ignore the "
           "throttle",
           curve=True, summary="chunks.over_quota", trouble="over quota", counter=True),
    Metric("stream/shut_out", "connections", "count",
           "Connections to the hub by processes whose certificates it does not admit",
           summary="shut_out", trouble="shut out", counter=True),
    Metric("stream/chunks_excess", "chunks", "count",
           "Chunks stored in excess of those that the actors made, so more than once",
           curve=True, summary="chunks.excess",
           bound=Bound("excess chunks", "=", 0,
                       "the replay stored chunks more than once, so they are drawn too often",
                       stops=False, quiet=True), counter=True),
    Metric("stream/stored", "steps", "count", "Steps in the replay", curve=True, summary="stored"),
    Metric("stream/samplable", "steps", "count", "Steps that can be drawn"),
    Metric("stream/throttled", "none", "count", "Whether actors are asked to pause: 0 or 1"),
    Metric("stream/capacity", "steps", "count", "Steps that the replay can hold",
           summary="capacity"),
    Metric("stream/actors_alive", "processes", "count", "Actors and evaluators that are alive",
           curve=True),
    Metric("stream/actors_present", "processes", "count",
           "Actors and evaluators that are alive or were lost"),
    Metric("stream/actors_starting", "processes", "count",
           "Actors and evaluators that local mode has started and that have not joined yet",
           trouble="starting"),
    Metric("gates/failed", "none", "count", "Health checks that were measured and failed",
           curve=True),
    Metric("replay/private_bytes", "bytes", "count",
           "Memory of the process that holds the replay, without file pages",
           summary="replay_process.private_bytes"),
    Metric("replay/resident_bytes", "bytes", "count",
           "Memory of the process that holds the replay, including file pages in memory",
           summary="replay_process.resident_bytes"),
    Metric("replay/file_bytes", "bytes", "count", "Size of the replay's files",
           summary="replay_process.file_bytes"),
    Metric("evaluation/steps_left", "steps", "count", "Test steps that are still to be played"),
    Metric("actors/elapsed_per_step", "ratio", ".2",
           "Agent steps of game time per step: more than 1 if robots wait or are late",
           summary="decisions_per_step"),
)
for _goal, _until in (("press", "command is down"), ("release", "previous command is up")):
    for _group, _when in (("run", "over the run"), ("hands", "recently")):
        _told = f"every key of the {_until}, {_when}"
        declare(*(
            Metric(f"{_group}/{_goal}_{_name}", _unit, _form, f"{_what} {_told}",
                   summary=f"{_goal}_ms.{_name}" if _group == "run" else "")
            for _name, _unit, _form, _what in _OF_LATENCY
            if f"{_group}/{_goal}_{_name}" not in METRICS
        ))
# fmt: on
declare(*(Metric(form="count", counter=True, **declared) for declared in COUNTERS.values()))

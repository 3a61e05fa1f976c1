"""The one snapshot of a run that the display, the curves and the summary all read.

The training loop makes a `Status` about once a second from its own counters and from what the
other processes tell; whoever shows or writes figures takes them from here and nowhere else, so
that the screen, TensorBoard and ``summary.json`` never disagree. None means: not known yet.
"""

from dataclasses import dataclass, field
from typing import Literal

from common.press_latency import UNMEASURED, Delay

Phase = Literal["warm-up", "training", "finishing"]


@dataclass(frozen=True)
class ClockMode:
    """How time passes for local mode's robots: the report's two switches, and the pace."""

    sync: bool
    """The world waits for the agent."""
    wait_action: bool
    """A decision lasts until the keys are as commanded."""
    speed: float
    """Game seconds per second, if not sync."""


@dataclass(frozen=True, kw_only=True)
class ActorStatus:
    """What one actor or evaluator last told about itself."""

    name: str
    role: Literal["actor", "evaluator"]
    alive: bool
    """Its liveliness token is there."""
    steps: int = 0
    """Agent steps since its process started."""
    steps_per_second: float = 0.0
    epsilon: float | None = None
    weights_version: int = 0
    made: int = 0
    """Chunks it made; with the next three, its side of the balance."""
    acked: int = 0
    retried: int = 0
    refused: int = 0
    held_share: float = 0.0
    """Of the last second it paused because the learner was behind."""
    valid_share: float = 0.0
    """Of its steps, those whose frame showed the screen: which robot is blind."""
    match_share: float = 0.0
    """Of its steps, those that ended with the commanded keys pressed."""
    decisions: int = 0
    """Of game time that its steps took."""
    missed_deadlines: int = 0
    """In real time: decisions that passed before their command."""
    late_frames: int = 0
    """In real time: emulator frames that began more than a frame too late."""
    waits_given_up: int = 0
    """Steps whose wait for the commanded keys ended at its bound."""
    silent_for: float = 0.0
    """Seconds since it was last heard of."""
    left: bool = False
    """It took its leave a while ago: no longer shown, still counted."""


@dataclass(frozen=True, kw_only=True)
class ChunkCounts:
    """Chunks of the whole run, over all actors that ever were."""

    made: int = 0
    acked: int = 0
    retried: int = 0
    duplicate: int = 0
    refused: int = 0


@dataclass(frozen=True, kw_only=True)
class TimeCounts:
    """How time went for all actors and evaluators that ever were."""

    steps: int = 0
    decisions: int = 0
    missed_deadlines: int = 0
    late_frames: int = 0
    waits_given_up: int = 0


@dataclass(frozen=True, kw_only=True)
class Gate:
    """A condition without which learning cannot be trusted; `learner.telemetry.health_checks`
    judges them."""

    name: str
    value: float | None
    """None while it has not been measured."""
    passed: bool | None
    bound: str
    """What is asked of the value, such as ``≥ 0.99``."""
    why: str
    """One line: what a failure means."""
    stops: bool = True
    """A run in which it stays red ends by itself; see `learner.telemetry.gate`."""


@dataclass(frozen=True, kw_only=True)
class Status:
    """The run at one moment. Times are wall-clock seconds, rates are per such second."""

    run: str
    preset: str
    env: str
    game: str
    device: str
    phase: Phase
    elapsed: float
    """Seconds of work on this run, those before a resume included."""
    remaining: float | None = None
    """Seconds to the end of the epoch, or of the warm-up."""

    agent_steps: int = 0
    """Steps of all actors, the warm-up included; the x axis of every curve."""
    steps_goal: int | None = None
    """Agent steps after which the run ends by itself."""
    warmup: int
    warmup_done: int = 0
    epoch: int = 0
    """1 for the first; 0 during the warm-up."""
    epoch_steps: int
    epoch_done: int = 0

    epsilon: float | None = None
    updates: int = 0
    loss: float | None = None
    mean_max_q: float | None = None
    """Over the held-out states."""
    held_out_std: float | None = None
    """Standard deviation of max-Q over the held-out states."""

    games: int = 0
    """Training games that ended."""
    train_reward: float | None = None
    """Mean score of the recent training games."""
    test_reward: float | None = None
    """Mean score of the latest finished test."""
    test_epoch: int | None = None
    """The epoch whose snapshot that test played."""
    random_reward: float | None = None
    """Mean score of the random policy."""
    train_history: tuple[float, ...] = ()
    """Mean training score of each epoch, oldest first."""
    test_history: tuple[float, ...] = ()
    """Mean test score of each epoch, oldest first."""

    steps_per_second: float | None = None
    updates_per_second: float | None = None
    samples_per_insert: float | None = None
    samples_per_insert_goal: float
    staleness_p50: float | None = None
    """Updates between the weights that chose a step and the newest, as it arrives."""
    staleness_p95: float | None = None
    weights_version: int = 0
    stored: int = 0
    """Steps in the replay."""
    capacity: int
    replay_private_bytes: int = 0
    """Memory of the process that holds the replay, without file pages."""
    replay_resident_bytes: int = 0
    """The same with the file pages that happen to be in memory."""
    replay_file_bytes: int = 0
    chunks: ChunkCounts = field(default_factory=ChunkCounts)
    time: TimeCounts = field(default_factory=TimeCounts)
    valid_frame_share: float | None = None
    press_match_share: float | None = None
    """Share of decisions at whose end the commanded keys, and no others, were pressed."""
    press: Delay = UNMEASURED
    """From a command to its keys, of late."""
    release: Delay = UNMEASURED
    """From a command until no other keys are pressed, of late."""
    press_in_all: Delay = UNMEASURED
    """The same over the whole run."""
    release_in_all: Delay = UNMEASURED

    actors: tuple[ActorStatus, ...] = ()
    gates: tuple[Gate, ...] = ()
    notes: tuple[str, ...] = ()
    """The latest events, newest last, such as "actor-2 was lost, restarted"."""

    @property
    def present(self) -> tuple[ActorStatus, ...]:
        """The actors without those that took their leave a while ago."""
        return tuple(actor for actor in self.actors if not actor.left)

    @property
    def gate_figures(self) -> dict[str, float | None]:
        """Each gate's value and the hands' other latencies, by their columns in ``gates.csv``."""
        return {
            **{gate.name.replace(" ", "_"): gate.value for gate in self.gates},
            "press_p50_ms": self.press.p50,  # its p99 is a gate's value
            "release_p50_ms": self.release.p50,
            "release_p99_ms": self.release.p99,
        }

    @property
    def failed_gates(self) -> tuple[Gate, ...]:
        """The gates that were measured and did not pass."""
        return tuple(gate for gate in self.gates if gate.passed is False)

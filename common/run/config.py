"""Everything a run can be told, as frozen dataclasses; the command line is made from them.

One `RunConfig` describes one experiment. The learner writes it into the run's folder, gives it
to every actor that asks, and refuses to resume a run under another one.
"""

import dataclasses
import json
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, TypeVar

from annotated_types import Ge, Le, Lt

from common.checked import Invalid, build
from common.errors import InputError
from common.proprioception import width_of
from common.protocol.wire import MAX_MESSAGE_BYTES

MAX_CHUNK_STEPS = 1_024
MAX_FRAME_STACK = 16
MAX_SEED = 2**63
MAX_WAIT = 50
MAX_SHIFT = 20
MAX_DELAY = 60
MAX_QUANTILES = 256

_FRAME_BYTES = 84 * 84 + 4
"""Of a frame in a message, with its place in a state."""
_STEP_BYTES = 32
"""Of all else that a message has of a step."""
_HEAD_BYTES = 65_536
"""Of a message, for all that does not grow with its steps."""

EnvKind = Literal["ale", "robot"]
PresetName = Literal["paper", "fast", "robot"]

RENAMED = {
    "play.history": "play.frame_stack",
    "play.delay": "play.command_latency",
    "play.release": "play.release_latency",
    "play.press": "play.press_latency",
    "camera.delay": "camera.latency",
    "replay.warmup": "replay.learning_starts",
    "learning.train_every": "learning.train_period",
    "learning.target_every": "learning.target_update_period",
    "learning.publish_every": "learning.publish_period",
    "learning.checkpoint_every": "learning.checkpoint_period",
    "learning.cut_random": "learning.watkins_cut",
    "exploration.lasting": "exploration.ez_greedy",
}
"""Former names of fields, as runs and policies on disk may have them, and the present ones."""

T = TypeVar("T")

Whole = Annotated[int, Ge(0)]
FromOne = Annotated[int, Ge(1)]
Amount = Annotated[float, Ge(0)]
Fraction = Annotated[float, Ge(0), Le(1)]
Latency = Annotated[int, Ge(0), Le(MAX_DELAY)]


@dataclass(frozen=True)
class PlayConfig:
    """How the game is played; the defaults are the report's section 4."""

    frame_stack: Annotated[int, Ge(2), Le(MAX_FRAME_STACK)] = 4
    """Frames that make a state."""
    frame_skip: FromOne = 4
    """Emulator frames per decision; 4 at 60 Hz are 66.7 ms."""
    random_starts: Whole = 30
    """Most random actions at the start of a game."""
    minimal_actions: bool = False
    """Offer the game's own actions (Pong: 6) instead of all 18."""
    max_game_frames: Whole = 108_000
    """A game longer than this (30 minutes at 60 Hz) is truncated; 0 for no bound."""
    read_keys: Literal["frame", "decision"] = "frame"
    """When the robot's controller is read: before every emulator frame, as a console does, or once
    per decision before the arms move, as in 2017."""
    wait_bound: Annotated[int, Ge(1), Le(MAX_WAIT)] = 8
    """Most decisions that a robot waits for its commanded keys, where it waits at all."""
    vector: bool = False
    """Show the last commands and keys, and a robot's joints, beside the frames."""
    eye: Literal["camera", "emulator"] = "camera"
    """What a robot's state shows: its camera's picture, or the emulator's own."""
    hand: Literal["arm", "model"] = "arm"
    """What presses a robot's keys: its hands, or a model of them with the next three, which the
    bare emulator has as well."""
    command_latency: Latency = 0
    """Command latency of the modelled hand, in agent steps."""
    release_latency: Latency = 0
    """Emulator frames until the modelled hand releases the keys of the previous command."""
    press_latency: Latency = 0
    """Emulator frames until the modelled hand presses the keys of the new command."""


@dataclass(frozen=True)
class CameraConfig:
    """How far the robot's camera is from a perfect one; all off by default."""

    noise: Annotated[float, Ge(0), Le(255)] = 0.0
    """Standard deviation of each pixel's noise, in grey levels of 255."""
    blur: Annotated[float, Ge(0), Le(20)] = 0.0
    """Standard deviation of the blur, in pixels."""
    exposure: Annotated[float, Ge(0), Le(0.9)] = 0.0
    """Most by which the brightness differs from game to game, as a share."""
    colour_gain: Annotated[float, Ge(0), Le(0.9)] = 0.0
    """Most by which each colour's gain differs from game to game, as a share."""
    distortion: Annotated[float, Ge(0), Le(0.3)] = 0.0
    """Radial lens distortion k₁, at the half width of the picture."""
    latency: Annotated[int, Ge(0), Le(3)] = 0
    """Latency of the picture, 0 to 3 agent steps."""
    camera_jitter: Annotated[float, Ge(0), Le(45)] = 0.0
    """Most by which the head's yaw and pitch differ from game to game, in degrees."""
    screen_jitter: Annotated[float, Ge(0), Le(0.5)] = 0.0
    """Most by which the screen's distance differs from game to game, as a share."""
    ambient: Annotated[float, Ge(0), Le(0.9)] = 0.0
    """Light that falls on the screen beside the projector's, as a share of white."""


@dataclass(frozen=True)
class StreamConfig:
    """How an actor's steps travel to the replay."""

    chunk_steps: Annotated[int, Ge(1), Le(MAX_CHUNK_STEPS)] = 64
    """Steps per chunk."""
    window: FromOne = 4
    """Chunks an actor may have unacknowledged."""


@dataclass(frozen=True)
class ReplayConfig:
    """What is remembered and how it is drawn."""

    capacity: Whole = 1_000_000
    """Slots of the ring, one frame (7,056 bytes) each."""
    learning_starts: Whole = 50_000
    """Random steps before the first update; they are also the random-policy baseline."""
    sampler: Literal["uniform", "prioritised"] = "uniform"
    """Draw every step alike, or in proportion to its last TD error."""
    priority_exponent: Amount = 0.6
    """α of prioritised replay (Schaul et al. 2016, equation 1)."""
    importance_exponent: Amount = 0.4
    """β of its importance weights."""
    ratio_tolerance: Whole = 1_000
    """Steps by which actors may run ahead of the learner, or it ahead of them."""


@dataclass(frozen=True)
class LearningConfig:
    """The update and its schedule."""

    algorithm: str = "dqn"
    """Algorithm: 'dqn' (with --learning.target double: Double DQN; equations 2 to 4 of the report)
    or 'qr_dqn' (quantile regression, Dabney et al. 2018)."""
    quantiles: Annotated[int, Ge(1), Le(MAX_QUANTILES)] = 51
    """Number of quantiles of each action's return that qr_dqn learns."""
    target: Literal["dqn", "double"] = "double"
    """Who chooses the next action: the target network (equation 3) or the online one (4)."""
    loss: Literal["mse", "huber"] = "huber"
    """Loss of dqn: δ² of the TD error δ, as in the report; or ½δ², growing only linearly beyond
    |δ| = 1. That of qr_dqn is the quantile Huber loss."""
    loss_mean_over: Literal["batch", "outputs"] = "batch"
    """Divisor of dqn's loss: the batch, or, as Keras did in 2017, batch × actions."""
    optimizer: Literal["adam", "rmsprop"] = "adam"
    """Optimizer: Adam, or RMSprop by the formula of Keras and PyTorch."""
    learning_rate: Amount = 1e-4
    """Of the optimizer, constant."""
    rmsprop_decay: Annotated[float, Ge(0), Lt(1)] = 0.95
    """ρ of RMSprop."""
    optimizer_epsilon: Amount = 1.5e-4
    """ε in the optimizer's denominator."""
    gradient_norm: Amount = 10.0
    """Longest gradient allowed; 0 for no bound."""
    initial_weights: Literal["torch", "glorot"] = "torch"
    """PyTorch's own, or Keras': Glorot uniform with zero biases."""
    scale_pixels: bool = True
    """Divide pixels by 255 before the first layer."""
    vector_scale: Amount = 1.0
    """Factor of the vector observation where it joins the convolutions' features, which are some
    0.04 at first: numbers of 1 move the layer after them far more than what is seen does."""
    dueling: bool = False
    """Value and advantages from half of the hidden units each (Wang et al. 2016)."""
    random_shift: Annotated[int, Ge(0), Le(MAX_SHIFT)] = 0
    """Most pixels by which a drawn state is shifted, up or down and left or right (DrQ, Yarats et
    al. 2021)."""
    clip_rewards: bool = True
    """Learn from each decision's reward clipped to [-1, 1]; scores are never clipped."""
    discount: Fraction = 0.99
    """γ per decision."""
    n_step: FromOne = 3
    """Rewards summed before the network's estimate takes over; 1 in the report."""
    watkins_cut: bool = False
    """End an n-step return before the first random action after its own (Watkins 1989): what comes
    of that says nothing of the policy that is learned."""
    batch_size: FromOne = 32
    """Transitions per update."""
    train_period: FromOne = 4
    """Agent steps per update."""
    target_update_period: FromOne = 2_000
    """Updates between copies to the target network."""
    publish_period: FromOne = 50
    """Updates between broadcasts of the weights."""
    checkpoint_period: FromOne = 5_000
    """Updates between checkpoints; one is also written at each epoch's end and at the stop."""


@dataclass(frozen=True)
class ExplorationConfig:
    """ε of the training actors: linear in the run's agent steps after the warm-up."""

    start: Fraction = 1.0
    """ε during the warm-up and at its end."""
    end: Fraction = 0.02
    """ε from then on."""
    steps: Whole = 100_000
    """Agent steps from one to the other, over all actors."""
    ez_greedy: bool = False
    """Let a random action last for 3 + Zipf(2) decisions, 12 at most (εz-greedy, Dabney et al.
    2021), begun as seldom as keeps the share of random decisions at ε."""
    per_env: bool = False
    """Raise ε to a power from 1 to 8, another one for each environment of an actor (Ape-X, Horgan
    et al. 2018)."""


@dataclass(frozen=True)
class ProtocolConfig:
    """Epochs and tests, as in the report: train, then test that epoch's snapshot."""

    epoch_steps: FromOne = 250_000
    """Agent steps of training per epoch, over all actors."""
    test_steps: FromOne = 125_000
    """Agent steps of testing per epoch, over all evaluators."""
    test_epsilon: Fraction = 0.05
    """ε of the evaluators."""
    held_out_states: FromOne = 1_024
    """States, drawn once after the warm-up, on which the mean max-Q is measured."""


@dataclass(frozen=True)
class RunConfig:
    """One experiment. Two processes belong to the same run when their RunConfigs are equal."""

    preset: PresetName = "robot"
    """Settings to start from; every other flag overrides it."""
    env: EnvKind = "robot"
    """'ale': the emulator alone (ALE-Only). 'robot': through NAO's camera and hands (ALE-Robot)."""
    game: str = "pong"
    """Any game that ale-py bundles, in snake_case."""
    seed: Annotated[int, Ge(0), Lt(MAX_SEED)] = 1
    """Of the first weights, the minibatches and the actors' games."""
    play: PlayConfig = field(default_factory=PlayConfig)
    camera: CameraConfig = field(default_factory=CameraConfig)
    stream: StreamConfig = field(default_factory=StreamConfig)
    replay: ReplayConfig = field(default_factory=ReplayConfig)
    learning: LearningConfig = field(default_factory=LearningConfig)
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    protocol: ProtocolConfig = field(default_factory=ProtocolConfig)

    @property
    def samples_per_insert(self) -> float:
        """Times each stored step is drawn on average (the report: 32 / 4 = 8)."""
        return self.learning.batch_size / self.learning.train_period

    @property
    def vector_width(self) -> int:
        """Numbers of the vector observation that stands beside the frames; 0 for none."""
        return width_of(self.env) if self.play.vector else 0

    def epsilon_at(self, agent_steps: int) -> float:
        """ε after this many agent steps, the warm-up included, over all actors."""
        schedule = self.exploration
        done = (agent_steps - self.replay.learning_starts) / max(schedule.steps, 1)
        return schedule.start + (schedule.end - schedule.start) * min(max(done, 0.0), 1.0)

    def check(self) -> None:
        """Refuses settings that cannot work, alone (the bounds beside each field) or together.

        Raises:
            InputError: with the field at fault and what to choose.
        """
        from_mapping(RunConfig, dataclasses.asdict(self), "")
        learning, replay, stream = self.learning, self.replay, self.stream
        # States travel in one message; a minibatch has two of each step.
        state_bytes = self.play.frame_stack * _FRAME_BYTES + 4 * self.vector_width + _STEP_BYTES
        most_states = (MAX_MESSAGE_BYTES - _HEAD_BYTES) // state_bytes
        for name, count, most in (
            ("protocol.held_out_states", self.protocol.held_out_states, most_states),
            ("learning.batch_size", learning.batch_size, most_states // 2),
        ):
            if count > most:
                raise InputError(
                    f"{name} is {count}: choose a number from 1 to {most}, as many as travel in "
                    f"one message with {self.play.frame_stack} frames each."
                )
        if replay.learning_starts < learning.batch_size + learning.n_step:
            raise InputError(
                f"replay.learning_starts is {replay.learning_starts}: the first minibatch needs at "
                f"least {learning.batch_size + learning.n_step} steps (batch_size + n_step)."
            )
        if replay.capacity < replay.learning_starts + 2 * stream.chunk_steps:
            raise InputError(
                f"replay.capacity is {replay.capacity}, but the warm-up alone needs "
                f"{replay.learning_starts + 2 * stream.chunk_steps} slots: raise it or "
                "lower replay.learning_starts."
            )
        least = max(stream.chunk_steps * stream.window, learning.train_period)
        if replay.ratio_tolerance < least:
            raise InputError(
                f"replay.ratio_tolerance is {replay.ratio_tolerance}, so actors and learner would "
                f"wait for each other for ever: choose at least {least} "
                "(chunk_steps × window, and train_period)."
            )


def to_json(config: Any) -> str:
    """A configuration dataclass as readable JSON."""
    return json.dumps(dataclasses.asdict(config), indent=2)


def from_mapping(kind: type[T], data: Any, where: str = "config", *, fill: bool = False) -> T:
    """Returns configuration dataclass ``kind`` built from plain data, strictly.

    Args:
        fill: take the default of a field that is missing in a group. For files, which may be older
            than the field; so a new field's default is what was done before there was one.

    Raises:
        InputError: a field is missing, unknown, of the wrong type or out of bounds; ``where`` names
            the place.
    """
    try:
        return build(kind, _with_present_names(data) if fill else data, where, fill=fill)
    except Invalid as error:
        raise InputError(f"{error}.") from None


def _with_present_names(data: Any) -> Any:
    """Returns ``data`` with the fields that a former version named otherwise under their names."""
    if not isinstance(data, dict):
        return data
    named = {group: dict(each) if isinstance(each, dict) else each for group, each in data.items()}
    for former, present in RENAMED.items():
        (group, old), new = former.split("."), present.split(".")[1]
        fields = named.get(group)
        if isinstance(fields, dict) and old in fields and new not in fields:
            fields[new] = fields.pop(old)
    return named


def differences(old: RunConfig, new: RunConfig) -> list[str]:
    """Names and values of the fields in which two configurations differ."""

    def flat(data: dict[str, Any], prefix: str = "") -> dict[str, Any]:
        found: dict[str, Any] = {}
        for name, value in data.items():
            if isinstance(value, dict):
                found |= flat(value, f"{prefix}{name}.")
            else:
                found[prefix + name] = value
        return found

    before, after = flat(dataclasses.asdict(old)), flat(dataclasses.asdict(new))
    return [
        f"{name} {before[name]} → {after[name]}" for name in before if before[name] != after[name]
    ]

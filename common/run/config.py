"""Configuration of a run: frozen dataclasses, from which the command line is generated.

One `RunConfig` describes one experiment. The learner writes it into the run's folder, gives it
to every actor that asks, and refuses to resume a run under another one.
"""

import dataclasses
import json
import math
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, TypeVar

from annotated_types import Ge, Le, Lt

from common.checked import Invalid, build
from common.errors import InputError
from common.protocol.step_fields import FRAME_SHAPE
from common.protocol.wire import MAX_MESSAGE_BYTES
from common.registry import ENVIRONMENTS, ROBOTS

MAX_CHUNK_STEPS = 1_024
MAX_FRAME_STACK = 16
MAX_SEED = 2**63
MAX_WAIT = 50
MAX_SHIFT = 20
MAX_DELAY = 60
MAX_QUANTILES = 256

_FRAME_BYTES = math.prod(FRAME_SHAPE) + 4
"""Size of a frame in a message, with its place in a state."""
_STEP_BYTES = 32
"""Size of a step's other fields in a message."""
_HEAD_BYTES = 65_536
"""Size of the parts of a message that do not grow with its steps."""

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
    """Game, observation and hands; the defaults are the 2017 settings."""

    frame_stack: Annotated[int, Ge(2), Le(MAX_FRAME_STACK)] = 4
    """Frames per state."""
    frame_skip: FromOne = 4
    """Emulator frames per agent step; 4 at 60 Hz are 66.7 ms."""
    random_starts: Whole = 30
    """Maximum number of random actions at the start of a game."""
    minimal_actions: bool = False
    """Action set: the game's own actions (Pong: 6) instead of all 18."""
    max_game_frames: Whole = 108_000
    """Emulator frames after which a game is truncated (108,000 are 30 minutes); 0 for no bound."""
    read_keys: Literal["frame", "decision"] = "frame"
    """Time at which the robot's controller is read: before every emulator frame, as a console does,
    or once per agent step before the arms move, as in 2017."""
    wait_bound: Annotated[int, Ge(1), Le(MAX_WAIT)] = 8
    """Maximum number of agent steps to wait for the commanded keys, with --wait-action."""
    vector: bool = False
    """Proprioception beside the frames: last commands, pressed keys, and a robot's joints."""
    eye: Literal["camera", "emulator"] = "camera"
    """Source of a robot's frames: its camera's picture, or the emulator's own."""
    robot: str = "nao"
    """Robot of --env robot: 'nao' or a registered one."""
    hand: Literal["arm", "model"] = "arm"
    """Actuator of a robot's keys: its arms, or a model with the next three latencies. The bare
    emulator always has the model."""
    command_latency: Latency = 0
    """Command latency of the modelled hand, in agent steps."""
    release_latency: Latency = 0
    """Emulator frames until the modelled hand releases the keys of the previous command."""
    press_latency: Latency = 0
    """Emulator frames until the modelled hand presses the keys of the new command."""


@dataclass(frozen=True)
class CameraConfig:
    """Faults of the robot's camera; all are off by default."""

    noise: Annotated[float, Ge(0), Le(255)] = 0.0
    """Standard deviation of each pixel's noise, grey levels of 255."""
    blur: Annotated[float, Ge(0), Le(20)] = 0.0
    """Standard deviation of the blur, pixels."""
    exposure: Annotated[float, Ge(0), Le(0.9)] = 0.0
    """Maximum relative change of the brightness between games."""
    colour_gain: Annotated[float, Ge(0), Le(0.9)] = 0.0
    """Maximum relative change of each colour's gain between games."""
    distortion: Annotated[float, Ge(0), Le(0.3)] = 0.0
    """Radial lens distortion k₁, at half the picture's width."""
    latency: Annotated[int, Ge(0), Le(3)] = 0
    """Latency of the picture, agent steps."""
    camera_jitter: Annotated[float, Ge(0), Le(45)] = 0.0
    """Maximum change of the head's yaw and pitch between games, degrees."""
    screen_jitter: Annotated[float, Ge(0), Le(0.5)] = 0.0
    """Maximum relative change of the screen's distance between games."""
    ambient: Annotated[float, Ge(0), Le(0.9)] = 0.0
    """Ambient light on the screen, as a share of white."""


@dataclass(frozen=True)
class StreamConfig:
    """Stream of an actor's steps to the replay."""

    chunk_steps: Annotated[int, Ge(1), Le(MAX_CHUNK_STEPS)] = 64
    """Steps per chunk."""
    window: FromOne = 4
    """Maximum number of unacknowledged chunks per actor."""


@dataclass(frozen=True)
class ReplayConfig:
    """Replay buffer and sampler."""

    capacity: Whole = 1_000_000
    """Slots of the ring, one frame (7,056 bytes) each."""
    learning_starts: Whole = 50_000
    """Random agent steps before the first update; they are also the random-policy baseline."""
    sampler: Literal["uniform", "prioritised"] = "uniform"
    """Sampler: uniform, or in proportion to each step's last TD error."""
    priority_exponent: Amount = 0.6
    """α of prioritised replay (Schaul et al. 2016, equation 1)."""
    importance_exponent: Amount = 0.4
    """β of the importance weights of prioritised replay."""
    ratio_tolerance: Whole = 1_000
    """Agent steps by which actors may run ahead of the learner, or the learner ahead of them."""


@dataclass(frozen=True)
class LearningConfig:
    """Algorithm, update and schedule."""

    algorithm: str = "dqn"
    """Algorithm: 'dqn' (with --learning.target double: Double DQN; equations 2 to 4 of 2017)
    or 'qr_dqn' (quantile regression, Dabney et al. 2018)."""
    quantiles: Annotated[int, Ge(1), Le(MAX_QUANTILES)] = 51
    """Number of quantiles of each action's return that qr_dqn learns."""
    target: Literal["dqn", "double"] = "double"
    """Network that chooses the next action: the target network (dqn) or the online network
    (double)."""
    loss: Literal["mse", "huber"] = "huber"
    """Loss of dqn: δ² of the TD error δ, as in 2017; or ½δ², growing only linearly beyond
    |δ| = 1. That of qr_dqn is the quantile Huber loss."""
    loss_mean_over: Literal["batch", "outputs"] = "batch"
    """Divisor of dqn's loss: the batch, or, as Keras did in 2017, batch × actions."""
    optimizer: Literal["adam", "rmsprop"] = "adam"
    """Optimizer: Adam, or RMSprop by the formula of Keras and PyTorch."""
    learning_rate: Amount = 1e-4
    """Learning rate of the optimizer, constant."""
    rmsprop_decay: Annotated[float, Ge(0), Lt(1)] = 0.95
    """ρ of RMSprop."""
    optimizer_epsilon: Amount = 1.5e-4
    """ε in the optimizer's denominator."""
    gradient_norm: Amount = 10.0
    """Maximum norm of the gradient; 0 for no bound."""
    weights_average: Annotated[float, Ge(0), Lt(1)] = 0.0
    """Decay per update of the exponential mean of the weights that is published, tested and
    evaluated; 0 for the weights themselves."""
    initial_weights: Literal["torch", "glorot"] = "torch"
    """Initial weights: PyTorch's, or Keras' (Glorot uniform with zero biases)."""
    scale_pixels: bool = True
    """Scaling of pixels by 1/255 before the first layer."""
    vector_scale: Amount = 1.0
    """Factor of the vector observation where it joins the convolutions' features. These are about
    0.04 at first, so values near 1 dominate the next layer."""
    dueling: bool = False
    """Dueling heads: value and advantages from half of the hidden units each (Wang et al. 2016)."""
    random_shift: Annotated[int, Ge(0), Le(MAX_SHIFT)] = 0
    """Maximum random shift of a sampled state in each direction, pixels (DrQ, Yarats et al.
    2021)."""
    clip_rewards: bool = True
    """Clipping of each agent step's reward to [-1, 1]; scores are never clipped."""
    discount: Fraction = 0.99
    """γ per agent step."""
    n_step: FromOne = 3
    """Agent steps of the n-step return; 1 in 2017."""
    watkins_cut: bool = False
    """Watkins cut: an n-step return ends before its next random action (Watkins 1989), whose
    outcome does not belong to the learned policy."""
    batch_size: FromOne = 32
    """Transitions per update."""
    train_period: FromOne = 4
    """Agent steps per update."""
    target_update_period: FromOne = 2_000
    """Updates between copies to the target network."""
    publish_period: FromOne = 50
    """Updates between broadcasts of the weights."""
    checkpoint_period: FromOne = 5_000
    """Updates between checkpoints; each epoch's end and the run's end write one too."""


@dataclass(frozen=True)
class ExplorationConfig:
    """ε of the training actors, linear in the run's agent steps after learning starts."""

    start: Fraction = 1.0
    """ε until learning starts."""
    end: Fraction = 0.02
    """ε after `steps`."""
    steps: Whole = 100_000
    """Agent steps from start to end, over all actors."""
    ez_greedy: bool = False
    """εz-greedy exploration (Dabney et al. 2021): a random action lasts for 3 + Zipf(2) agent
    steps, at most 12, and starts so seldom that the share of random steps is ε."""
    per_env: bool = False
    """ε by environment: ε to a power from 1 to 8, different for each environment of an actor
    (Ape-X, Horgan et al. 2018)."""


@dataclass(frozen=True)
class ProtocolConfig:
    """Epochs and tests as in 2017: train, then test that epoch's snapshot."""

    epoch_steps: FromOne = 250_000
    """Agent steps of training per epoch, over all actors."""
    test_steps: FromOne = 125_000
    """Agent steps of the test per epoch, over all evaluators."""
    test_epsilon: Fraction = 0.05
    """ε of the evaluators."""
    held_out_states: FromOne = 1_024
    """States, drawn once when learning starts, on which the mean max-Q is measured."""


@dataclass(frozen=True)
class RunConfig:
    """One experiment. Two processes belong to the same run when their RunConfigs are equal."""

    preset: PresetName = "robot"
    """Preset of settings; every other flag overrides it."""
    env: str = "robot"
    """Environment: 'ale', the emulator alone (ALE-Only); 'robot', a robot's camera and hands
    (ALE-Robot); or a registered one."""
    game: str = "pong"
    """Game: any that ale-py bundles, in snake_case."""
    seed: Annotated[int, Ge(0), Lt(MAX_SEED)] = 1
    """Seed of the initial weights, the minibatches and the actors' games."""
    play: PlayConfig = field(default_factory=PlayConfig)
    camera: CameraConfig = field(default_factory=CameraConfig)
    stream: StreamConfig = field(default_factory=StreamConfig)
    replay: ReplayConfig = field(default_factory=ReplayConfig)
    learning: LearningConfig = field(default_factory=LearningConfig)
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    protocol: ProtocolConfig = field(default_factory=ProtocolConfig)

    @property
    def samples_per_insert(self) -> float:
        """Times that each stored step is drawn on average (2017: 32 / 4 = 8)."""
        return self.learning.batch_size / self.learning.train_period

    @property
    def vector_width(self) -> int:
        """Width of the vector observation beside the frames; 0 for none."""
        return ENVIRONMENTS.find(self.env).vector_width(self.play) if self.play.vector else 0

    @property
    def action_count(self) -> int:
        """Actions that the environment offers. Raises InputError for a game that there is not."""
        return ENVIRONMENTS.find(self.env).actions(self)

    def epsilon_at(self, agent_steps: int) -> float:
        """Returns ε after ``agent_steps`` of all actors, those before learning starts included."""
        schedule = self.exploration
        done = (agent_steps - self.replay.learning_starts) / max(schedule.steps, 1)
        return schedule.start + (schedule.end - schedule.start) * min(max(done, 0.0), 1.0)

    def check(self) -> None:
        """Refuses settings that cannot work, alone (the bounds beside each field) or together.

        Raises:
            InputError: with the field at fault and what to choose.
        """
        from_mapping(RunConfig, dataclasses.asdict(self), "")
        if ENVIRONMENTS.find(self.env).robot:
            ROBOTS.find(self.play.robot)
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
                f"replay.capacity is {replay.capacity}, but replay.learning_starts needs "
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
    """Returns a configuration dataclass as readable JSON."""
    return json.dumps(dataclasses.asdict(config), indent=2)


def from_mapping(kind: type[T], data: Any, where: str = "config", *, fill: bool = False) -> T:
    """Returns configuration dataclass ``kind`` built from plain data, strictly.

    Args:
        fill: take the default of a field that is missing in a group, for files that are older than
            the field. The default of a new field must therefore be the former behaviour.

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

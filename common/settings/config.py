"""Configuration of a run: frozen dataclasses, from which the command line is generated.

One `RunConfig` describes one experiment. The learner writes it into the run's folder, and
refuses to resume the run under a different one; the replay gives it to every actor that asks.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Le, Lt

from common.checked import Amount, Count, Fraction, FromOne, LongText, Score
from common.pinned_file import path_of, pin
from common.registry import ENVIRONMENTS, Entry
from common.settings.conditions import CameraConfig, PlayConfig
from common.settings.own_settings import EXTENSIONS, in_full
from common.settings.ranges import RandomiseConfig

MAX_CHUNK_STEPS = 1_024
MAX_WINDOW = 64
MAX_ENVS = 256
MAX_SEED = 2**63
Seed = Annotated[int, Ge(0), Lt(MAX_SEED)]

PresetName = Literal["paper", "fast", "robot", "frugal"]
InitialWeights = Literal["torch", "glorot", "he"]
NetworkName = Literal["nature", "nips"]


@dataclass(frozen=True)
class StreamConfig:
    """Stream of an actor's steps to the replay."""

    chunk_steps: Annotated[int, Ge(1), Le(MAX_CHUNK_STEPS)] = 64
    """Number of steps per chunk."""
    window: Annotated[int, Ge(1), Le(MAX_WINDOW)] = 4
    """Maximum number of chunks per actor that are sent and not yet acknowledged."""


@dataclass(frozen=True)
class ReplayConfig:
    """Replay buffer and sampler."""

    capacity: Count = 1_000_000
    """Number of slots of the ring, one frame (7,056 bytes) each."""
    learning_starts: Count = 50_000
    """Number of random agent steps before the first update; they also give the baseline of the
    random policy."""
    sampler: str = "uniform"
    """Sampler: 'uniform'; 'prioritised', in proportion to each step's last TD error; or a
    registered one."""
    sampler_settings: LongText = ""
    """Settings that a registered sampler declares for itself, such as 'newest=0.5'; the help of all
    flags lists them beside --replay.sampler NAME."""
    priority_exponent: Fraction = 0.6
    """α of prioritised replay (Schaul et al. 2016, equation 1)."""
    importance_exponent: Fraction = 0.4
    """β of the importance weights of prioritised replay."""
    ratio_tolerance: Count = 1_000
    """Maximum number of agent steps by which actors and learner may run ahead of each other."""


@dataclass(frozen=True)
class LearningConfig:
    """Algorithm, update and schedule."""

    algorithm: str = "dqn"
    """Algorithm: 'dqn' (equations 2 to 4 of 2017; Double DQN with --learning.target double), or
    'qr_dqn' (quantile regression, Dabney et al. 2018)."""
    algorithm_settings: LongText = ""
    """Settings that a registered algorithm declares for itself, such as 'kappa=0.5'; the help of
    all flags lists them beside --learning.algorithm NAME."""
    quantiles: Annotated[int, Ge(1), Le(256)] = 51
    """Number of quantiles of each action's return that qr_dqn learns."""
    network: NetworkName = "nature"
    """Network: 'nature' has three convolutions and 512 hidden units (Mnih et al. 2015, and 2017);
    'nips' has two and 256, with a third of the arithmetic (Mnih et al. 2013)."""
    target: Literal["dqn", "double"] = "double"
    """Network that chooses the next action in the target: the target network ('dqn') or the online
    network ('double')."""
    early_choice: bool = False
    """With --learning.target double on a CPU: let the online network choose the next actions while
    the update before is computed, by weights that are one to three updates old, whenever another
    core has time for it."""
    loss: Literal["mse", "huber"] = "huber"
    """Loss of dqn for a TD error δ: 'mse' is δ², as in 2017; 'huber' is ½δ², linear beyond
    |δ| = 1. qr_dqn always uses the quantile Huber loss."""
    loss_mean_over: Literal["batch", "outputs"] = "batch"
    """Divisor of dqn's loss: the batch size, or ('outputs') batch size × actions, as Keras did in
    2017."""
    optimizer: Literal["adam", "rmsprop"] = "adam"
    """Optimizer: Adam, or RMSprop as Keras and PyTorch define it."""
    learning_rate: Amount = 1e-4
    """Initial learning rate of the optimizer."""
    annealing_steps: Count = 0
    """Number of agent steps, counted from when learning starts, in which the learning rate falls
    linearly to --learning.final-learning-rate; 0 for a constant rate."""
    final_learning_rate: Amount = 1e-5
    """Learning rate after --learning.annealing-steps."""
    rmsprop_decay: Annotated[float, Ge(0), Lt(1)] = 0.95
    """ρ of RMSprop."""
    optimizer_epsilon: Annotated[float, Ge(1e-12)] = 1.5e-4
    """ε in the optimizer's denominator."""
    gradient_norm: Amount = 10.0
    """Maximum norm of the gradient; 0 for no limit."""
    weights_average: Annotated[float, Ge(0), Lt(1)] = 0.0
    """Decay per update of the exponential mean of the weights, which is then published, tested and
    evaluated, and takes them in at every fourth update; 0 to use the weights themselves."""
    initial_weights: InitialWeights = "torch"
    """Initial weights: 'torch', PyTorch's default; 'glorot', Glorot uniform with zero biases, as in
    Keras; 'he', normal (He et al. 2015) with zero biases, a tenth in the last layer."""
    layer_norm: bool = False
    """Layer normalisation of the 512 or 256 hidden units (Ba et al. 2016)."""
    scale_pixels: bool = True
    """Scaling of pixels by 1/255 before the first layer, or by 1/64 with
    --learning.center-pixels."""
    center_pixels: bool = False
    """Subtraction of a state's mean grey level from its pixels. Most of a picture is background,
    whose grey would otherwise drive units of the first layers to 0 for all pictures."""
    frame_differences: bool = False
    """Frames of a state as differences from the previous frame; the oldest frame stays as it is.
    What moves is then separate from what stands still, which is most of a picture."""
    random_shift: Annotated[int, Ge(0), Le(20)] = 0
    """Maximum random shift of a sampled state in each direction, pixels (DrQ, Yarats et al.
    2021)."""
    curriculum_steps: Count = 0
    """Number of agent steps, counted from when learning starts, in which the ranges of --randomise
    grow linearly from nothing in training games; 0 for full ranges from the beginning. Tests always
    use the full ranges."""
    curriculum_score: Score | None = None
    """Threshold for the mean score of the last five training games: the ranges grow at or above it
    and shrink below it, at the same pace. None: they grow whatever the score. After automatic
    domain randomization (OpenAI 2019), with one width for all ranges."""
    clip_rewards: bool = True
    """Clipping of each agent step's reward to [-1, 1]; scores are never clipped."""
    losses_end_returns: bool = False
    """End of the return at a negative reward, such as a lost point in Pong, as at a lost life
    (Mnih et al. 2015). What follows is then lost too, so that losing counts for more than winning a
    little later. Not for games in which each step costs something, such as Skiing."""
    discount: Fraction = 0.99
    """γ per agent step."""
    n_step: FromOne = 3
    """Number of agent steps of the n-step return; 1 in 2017."""
    batch_size: FromOne = 32
    """Number of transitions per update."""
    train_period: FromOne = 4
    """Number of agent steps per update."""
    target_update_period: FromOne = 2_000
    """Number of updates between copies to the target network."""
    publish_period: FromOne = 50
    """Number of updates between broadcasts of the weights."""
    checkpoint_period: FromOne = 5_000
    """Number of updates between checkpoints. The end of each epoch and of the run writes one
    too."""

    def learning_rate_at(self, updates: int) -> float:
        """Returns the learning rate of the update after ``updates``."""
        done = updates * self.train_period / self.annealing_steps if self.annealing_steps else 0.0
        return self.learning_rate + (self.final_learning_rate - self.learning_rate) * min(done, 1.0)


@dataclass(frozen=True)
class ExplorationConfig:
    """ε of the training actors: linear in the run's agent steps once learning starts."""

    start: Fraction = 1.0
    """ε until learning starts."""
    end: Fraction = 0.02
    """ε after --exploration.steps."""
    steps: Count = 100_000
    """Number of agent steps, over all actors, in which ε goes from start to end."""
    ez_greedy: bool = False
    """εz-greedy exploration (Dabney et al. 2021): a random action lasts 3 + Zipf(2) agent steps, at
    most 12. Such actions start less often, so that the share of random steps is still ε."""


@dataclass(frozen=True)
class ProtocolConfig:
    """Epochs and tests as in 2017: train, then test that epoch's snapshot."""

    epoch_steps: FromOne = 250_000
    """Number of training agent steps per epoch, over all actors."""
    test_steps: FromOne = 125_000
    """Number of test agent steps per epoch, over all evaluators."""
    test_epsilon: Fraction = 0.05
    """ε of the evaluators."""
    held_out_states: FromOne = 1_024
    """Number of states on which the mean max-Q is measured; they are drawn once, when learning
    starts."""


@dataclass(frozen=True)
class RunConfig:
    """One experiment. Processes of the same run have equal RunConfigs."""

    preset: PresetName = "robot"
    """Preset of settings; every other flag overrides it."""
    env: str = "robot"
    """Environment: 'ale', the emulator alone (ALE-Only); 'robot', a robot's camera and hands
    (ALE-Robot); or a registered one."""
    game: str = "pong"
    """Game: any that ale-py bundles, in snake_case."""
    seed: Seed = 1
    """Seed of the initial weights, the minibatches and the actors' games."""
    play: PlayConfig = field(default_factory=PlayConfig)
    camera: CameraConfig = field(default_factory=CameraConfig)
    randomise: RandomiseConfig = field(default_factory=RandomiseConfig)
    stream: StreamConfig = field(default_factory=StreamConfig)
    replay: ReplayConfig = field(default_factory=ReplayConfig)
    learning: LearningConfig = field(default_factory=LearningConfig)
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    protocol: ProtocolConfig = field(default_factory=ProtocolConfig)

    @property
    def task(self) -> str:
        """What is played: the Atari game, or the environment itself if it has none."""
        return self.game if ENVIRONMENTS.find(self.env).atari else self.env

    @property
    def played(self) -> str:
        """What is played by whom, for people: "pong (robot)", "pong (robotroller)" or "catch"."""
        if self.task == self.env:
            return self.env
        usual = self.play.robot == PlayConfig.robot or not ENVIRONMENTS.find(self.env).robot
        return f"{self.task} ({self.env if usual else Path(self.play.robot).name})"

    @property
    def hands(self) -> str | None:
        """Name of the robot whose hands press the keys, or path of the latency model in their
        place; None if the run uses neither."""
        played = ENVIRONMENTS.find(self.env).robot or self.play.latency_model
        return str(path_of(self.play.robot)) if played else None

    @property
    def samples_per_insert(self) -> float:
        """Number of times that each stored step is drawn, on average (2017: 32 / 4 = 8)."""
        return self.learning.batch_size / self.learning.train_period

    @property
    def vector_width(self) -> int:
        """Width of the vector observation beside the frames; 0 for none."""
        return ENVIRONMENTS.find(self.env).vector_width(self.play) if self.play.vector else 0

    @property
    def action_count(self) -> int:
        """Number of actions of the environment. Raises InputError for an unknown game."""
        return ENVIRONMENTS.find(self.env).actions(self)

    @property
    def without_sampler(self) -> "RunConfig":
        """The settings for whoever plays, without the sampler, whose package is not needed."""
        replay = replace(self.replay, sampler=ReplayConfig.sampler, sampler_settings="")
        return replace(self, replay=replay)

    @property
    def for_play(self) -> "RunConfig":
        """The settings for playing what a run has learned: without sampler, and without ranges, so
        that every game has the conditions of `play` and `camera`."""
        return replace(self.without_sampler, randomise=RandomiseConfig())

    def epsilon_at(self, agent_steps: int) -> float:
        """Returns ε after ``agent_steps`` of all actors, including those before learning starts."""
        schedule = self.exploration
        done = (agent_steps - self.replay.learning_starts) / max(schedule.steps, 1)
        return schedule.start + (schedule.end - schedule.start) * min(max(done, 0.0), 1.0)

    def difficulty_after(self, curriculum_steps: int) -> float:
        """Returns the share of their full widths, 0 to 1, that the ranges of `randomise` have in
        training games after so many steps of the curriculum."""
        whole = self.learning.curriculum_steps
        return min(curriculum_steps / whole, 1.0) if whole else 1.0

    def pinned(self) -> "RunConfig":
        """Returns the settings, with its hash added to each file that they name. Raises InputError
        if a file cannot be read."""
        play = self.play
        if play.latency_model:
            play = replace(play, robot=pin(play.latency_model))
        if play.hands_model:
            play = replace(play, hands_model=pin(play.hands_model))
        return self if play == self.play else replace(self, play=play)

    def in_full(self) -> "RunConfig":
        """Returns the settings with the values of all that extensions declare for themselves."""
        found = self
        for entry, setting, text in self.extensions():
            group, name = setting.split(".")
            changed = replace(getattr(found, group), **{name: in_full(entry, text)})
            found = replace(found, **{group: changed})
        return found

    def extensions(self) -> Iterator[tuple[Entry, str, str]]:
        """Yields environment, robot, algorithm and sampler, each with the name and the text of its
        own settings. Without a robot, the robot of the settings may be unknown here."""
        for name, where, registry in EXTENSIONS:
            text = attrgetter(where)(self)
            if name == "play.robot" and not (text or ENVIRONMENTS.find(self.env).robot):
                continue
            yield registry.find(attrgetter(name)(self)), where, text

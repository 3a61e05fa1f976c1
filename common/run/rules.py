"""The checks of a run's settings: the bounds beside each, and the rules between them."""

from collections.abc import Sequence
from dataclasses import asdict, fields
from operator import attrgetter

from common.errors import InputError
from common.pinned_file import path_of
from common.proprioception import MAX_VECTOR
from common.protocol.step_fields import FRAME_BYTES, drawn_fields
from common.protocol.wire import MAX_MESSAGE_BYTES
from common.registry import ENVIRONMENTS, foreign
from common.settings.conditions import (
    DEFAULT_PLAY,
    FRAMES_PER_SECOND,
    OF_ARMS,
    OF_MODELLED_HANDS,
    CameraConfig,
    LatencyModelSettings,
    marked,
)
from common.settings.config import RunConfig
from common.settings.fit import VECTOR_PARTS
from common.settings.own_settings import ROBOT, check_own_settings, own_settings
from common.settings.ranges import DRAWN, check_ranges, ignored_in
from common.settings.stored_config import from_mapping

_DEFAULTS = RunConfig()
_OF_MODELLED_HANDS = marked(OF_MODELLED_HANDS)
_OF_ARMS = marked(OF_ARMS)
_HANDS_AND_EYE = ["play.hand", "play.eye"]
_OF_A_CAMERA = [f"camera.{field.name}" for field in fields(CameraConfig)]
_OF_ALL_RANGES = {f"randomise.{name}": how.published for name, how in DRAWN.items()}
"""Ranges of ``--randomise.all``, which gives all of them whatever the hands and the eye."""
_PLACE_BYTES = 4
"""Size in a message of a frame's place in a state."""
_TRANSITION_BYTES = 32
"""Size in a minibatch of a transition's id, action, return, discount and weight."""
_HEAD_BYTES = 65_536
"""Size of the parts of a message that do not grow with its steps."""


def check_config(config: RunConfig) -> None:
    """Checks each setting by the bounds beside its field, and then all of them together. Raises
    InputError with the setting at fault and what to choose."""
    check_play(config)
    _check_learning_rate(config)
    _check_messages(config)
    _check_replay(config)


def check_play(config: RunConfig) -> None:
    """Checks as `check_config` does, but for the rules of learning, messages and replay, which do
    not concern who only plays."""
    from_mapping(RunConfig, asdict(config), "")
    for entry, name, text in config.extensions():
        check_own_settings(entry, text, name)
    with foreign(f"`actions` of the environment {config.env!r}"):
        ENVIRONMENTS.find(config.env).actions(config)  # raises for an unknown game
    check_ignored(config)
    check_ranges(config.play, config.camera, config.randomise)
    _check_hands(config)


def check_chosen(before: RunConfig, config: RunConfig) -> None:
    """Refuses what the flags chose and has no effect: a robot that nobody plays by, parts of a
    vector that nobody gets, and properties of hands or of a camera that are not used. Those of the
    settings ``before`` may stay, so that the emulator alone plays what any robot learned, and every
    stored run goes on; so may defaults, which turn something off."""
    env, play = config.env, config.play
    robot = ENVIRONMENTS.find(env).robot
    modelled = play.hand == "model"
    for unused, names, needs in (
        (not play.vector, VECTOR_PARTS, "without play.vector: give that too"),
        (robot and not modelled, _OF_MODELLED_HANDS, "to arms: give play.hand model too"),
        (robot and modelled, _OF_ARMS, "without arms: give play.hand arm too"),
        (bool(play.latency_model), _OF_ARMS, "to a latency model: choose another play.robot"),
        (robot and play.eye == "emulator", _OF_A_CAMERA, "without a camera: give play.eye camera"),
        (not robot, _HANDS_AND_EYE, "without a robot: choose env robot"),
    ):
        for name in _with_ranges(names) if unused else ():
            value, usual, off = (attrgetter(name)(each) for each in (config, before, _DEFAULTS))
            if value not in (usual, off, _OF_ALL_RANGES.get(name)):
                raise InputError(
                    f"{name} is {value}, which means nothing {needs}, or leave it at {usual}."
                )
    chosen = play.robot != before.play.robot and not play.latency_model
    if chosen and not robot:
        raise InputError(
            f"--robot {play.robot} is for a robot, and --env {env} has none: add --env robot, or "
            "name a latency model, FILE.npz."
        )


def _with_ranges(names: Sequence[str]) -> list[str]:
    """Returns ``names`` and the ranges around these settings alone."""
    return [
        *names,
        *(f"randomise.{name}" for name, how in DRAWN.items() if {*how.settings} <= {*names}),
    ]


def check_ignored(config: RunConfig) -> None:
    """Refuses settings that have no effect in the environment, unless they have their defaults."""
    for name in ignored_in(config.env):
        value, usual = map(attrgetter(name), (config, _DEFAULTS))
        if value != usual:
            shown = f"{usual:g}" if isinstance(usual, float) else usual
            raise InputError(
                f"{name} is {value}, which means nothing in --env {config.env}: leave it at "
                f"{shown}."
            )


def _check_hands(config: RunConfig) -> None:
    play = config.play
    if play.latency_model and (play.hand == "model" or play.press_latency):
        raise InputError(
            f"play.robot is {path_of(play.robot)}, which models the hands by itself: leave "
            "play.hand at 'arm' and play.press_latency at 0."
        )
    for name, shown in (("equal_gap", play.equal_gap), ("hands_model", path_of(play.hands_model))):
        usual = getattr(DEFAULT_PLAY, name)
        if getattr(play, name) != usual and not play.equal_latency:
            raise InputError(
                f"play.{name} is {shown}, which means nothing without play.equal_latency: give "
                f"that too, or leave it at {usual!r}."
            )
    if play.hands_model:
        _check_modelled(config)


def _check_modelled(config: RunConfig) -> None:
    """Checks that there are hands of which ``play.hands_model`` may be a model."""
    play, model = config.play, path_of(config.play.hands_model)
    if not play.latency_model and (play.hand == "model" or not ENVIRONMENTS.find(config.env).robot):
        raise InputError(
            f"play.hands_model is {model}, a model of hands that do not play here: name them by "
            "--robot (the model itself can be them), or leave it at ''."
        )
    if play.latency_model:
        rate = own_settings(LatencyModelSettings, play.robot_settings, ROBOT.text).rate
        if rate != FRAMES_PER_SECOND:
            raise InputError(
                f"play.hands_model takes {FRAMES_PER_SECOND} commands a second, and "
                f"{path_of(play.robot)} only {rate}: add --play.robot-settings "
                f"rate={FRAMES_PER_SECOND}."
            )


def _check_learning_rate(config: RunConfig) -> None:
    learning = config.learning
    if learning.annealing_steps and learning.final_learning_rate > learning.learning_rate:
        raise InputError(
            f"learning.learning_rate {learning.learning_rate:g} would rise to "
            f"learning.final_learning_rate {learning.final_learning_rate:g}: lower that too, "
            "or set learning.annealing_steps to 0 for a constant rate."
        )


def _check_messages(config: RunConfig) -> None:
    """Checks that states fit into messages. Held-out states, and a minibatch, travel in one."""
    width, frame_stack = config.vector_width, config.play.frame_stack
    if width > MAX_VECTOR:
        raise InputError(
            f"the vector observation has {width} numbers: lower play.vector_commands or "
            f"play.vector_key_frames, until it has at most {MAX_VECTOR}."
        )
    state_bytes = frame_stack * (FRAME_BYTES + _PLACE_BYTES) + 4 * width
    drawn_bytes = sum(field.step_bytes(width) for field in drawn_fields().values())
    transition_bytes = 2 * state_bytes + _TRANSITION_BYTES + drawn_bytes
    for name, count, size in (
        ("protocol.held_out_states", config.protocol.held_out_states, state_bytes),
        ("learning.batch_size", config.learning.batch_size, transition_bytes),
    ):
        most = (MAX_MESSAGE_BYTES - _HEAD_BYTES) // size
        if count > most:
            raise InputError(
                f"{name} is {count}: choose a number from 1 to {most}, as many as travel in one "
                f"message with {frame_stack} frames each."
            )


def _check_replay(config: RunConfig) -> None:
    learning, replay, stream = config.learning, config.replay, config.stream
    if replay.learning_starts < learning.batch_size + learning.n_step:
        raise InputError(
            f"replay.learning_starts is {replay.learning_starts}: the first minibatch needs at "
            f"least {learning.batch_size + learning.n_step} steps (learning.batch_size + "
            "learning.n_step)."
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
            "(stream.chunk_steps × stream.window, and learning.train_period)."
        )

"""The conditions of a game: its rules, what the hands and the eye are like, and how they are drawn.

`PlayConfig` and `CameraConfig` have the settings. A field of `RandomiseConfig` is a range around
some of them, and says how they are drawn from it, anew for each game. Whoever plays a game gets
plain settings, as if somebody had chosen them, and knows nothing of ranges. docs/conditions.md
describes all of them.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from math import ceil
from typing import Annotated, Any, Final, Literal, NamedTuple, get_type_hints

import tyro
from annotated_types import Ge, Le

from common.checked import Amount, Count, Fraction
from common.errors import InputError
from common.pinned_file import path_of
from common.run.stored_config import from_mapping

FRAMES_PER_SECOND = 60
"""Emulator frames in a second of game time."""
MAX_FRAME_STACK = 16
MAX_STARTS = 10_000
MAX_WAIT = 50
MAX_ADDED = 36
"""Emulator frames of added latency, 600 ms."""
MAX_PICTURE_LATENCY = 3
"""Agent steps."""
MAX_HISTORY = 60
"""Commands in the vector observation, 4 s."""

OF_A_ROBOT: Final = "of a robot"
"""Marks a setting of arms, colours or poses, which the emulator's grey picture has not."""

Latency = Annotated[int, Ge(0), Le(60)]
AddedLatency = Annotated[int, Ge(0), Le(MAX_ADDED)]
Gain = Annotated[float, Ge(0.05), Le(2)]


@dataclass(frozen=True)
class PlayConfig:
    """Game, observation and hands; the defaults are the 2017 settings."""

    frame_stack: Annotated[int, Ge(2), Le(MAX_FRAME_STACK)] = 4
    """Frames per state."""
    frame_skip: Annotated[int, Ge(1), Le(FRAMES_PER_SECOND)] = 4
    """Emulator frames per agent step; 4 at 60 Hz are 66.7 ms."""
    random_starts: Annotated[int, Ge(0), Le(MAX_STARTS)] = 30
    """Maximum number of random actions at the start of a game."""
    minimal_actions: bool = False
    """Action set: the game's own actions (Pong: 6) instead of all 18."""
    max_game_frames: Count = 108_000
    """Emulator frames after which a game is truncated (108,000 are 30 minutes); 0 for no bound."""
    sticky: Fraction = 0.0
    """Repeat probability: share of emulator frames, 0 to 1, in which the console repeats the action
    of the frame before, whatever is pressed (sticky actions, Machado et al. 2018; 0.25 in ALE's
    v5)."""
    read_keys: Literal["frame", "decision"] = "frame"
    """Time at which the robot's controller is read: before every emulator frame, as a console does,
    or once per agent step before the arms move, as in 2017."""
    wait_bound: Annotated[int, Ge(1), Le(MAX_WAIT)] = 8
    """Maximum number of agent steps to wait for the commanded keys, with --wait-action."""
    vector: bool = False
    """Proprioception beside the frames: last commands, pressed keys, and a robot's joints."""
    vector_commands: Annotated[int, Ge(1), Le(MAX_HISTORY)] = 6
    """Number of the last commands in --play.vector, one per agent step; a latency can be inferred
    from them and the keys only if both reach as far back."""
    vector_key_frames: Annotated[int, Ge(1), Le(4 * MAX_HISTORY)] = 4
    """Number of the last emulator frames whose pressed keys are in --play.vector."""
    vector_joints: bool = True
    """Angles and speeds of a robot's joints in --play.vector; without them a network fits any
    robot, and the bare emulator."""
    vector_forecast: Annotated[int, Ge(0), Le(MAX_HISTORY)] = 0
    """Number of the next emulator frames whose keys are forecast in --play.vector, from the
    commands so far and the latency that the hands have shown."""
    eye: Literal["camera", "emulator"] = "camera"
    """Source of a robot's frames: its camera's picture, or the emulator's own."""
    robot: Annotated[str, tyro.conf.arg(aliases=["--robot"])] = "nao"
    """Robot of --env robot: 'nao', 'robotroller', a registered one, or FILE.npz: NAO with a latency
    model in the place of its hands, in the format of Physical Atari. The bare emulator follows such
    a model too. The run keeps the file's SHA-256, and each process needs the same file."""
    hand: Literal["arm", "model"] = "arm"
    """Actuator of a robot's keys: its arms, or a model with --play.press-latency. The bare emulator
    always has the model."""
    press_latency: Latency = 0
    """Emulator frames until the modelled hand presses the keys of a new command; it releases those
    of the previous one at once."""
    actuation_latency: AddedLatency = 0
    """Emulator frames of 16.7 ms by which every command reaches any hand later, arms and model;
    36 are 600 ms."""
    actuation_jitter: AddedLatency = 0
    """Maximum of further emulator frames by which a command is late, drawn for each one; commands
    keep their order."""
    equal_latency: AddedLatency = 0
    """Emulator frames from what is seen until all hands release their keys; they press new ones a
    frame later, or two on their way from others, as NAO's do. Quicker ones, found by timing keys
    and eye, get their commands later; 0 for at once."""
    arm_speed: Annotated[float, Ge(0.25), Le(1.1), OF_A_ROBOT] = 1.0
    """Maximum speed of the arms' joints, relative to the usual one, which is 0.9 of the published
    speed."""
    key_threshold: Annotated[float, Ge(0.5), Le(1.4), OF_A_ROBOT] = 1.0
    """Depths at which a key counts as pressed and as released, relative to the usual ones."""

    @property
    def steps_per_second(self) -> float:
        """Agent steps in a second of game time."""
        return FRAMES_PER_SECOND / self.frame_skip

    @property
    def latency_model(self) -> str | None:
        """The file that says what the hands do; None where it is a robot that does it."""
        return self.robot if path_of(self.robot).suffix == ".npz" else None


@dataclass(frozen=True)
class CameraConfig:
    """Light, camera and pose of the robot's eye; the defaults are a perfect camera at its usual
    place."""

    noise: Annotated[float, Ge(0), Le(255)] = 0.0
    """Standard deviation of each pixel's noise, grey levels of 255."""
    blur: Annotated[float, Ge(0), Le(20)] = 0.0
    """Standard deviation of the blur, pixels."""
    distortion: Annotated[float, Ge(0), Le(0.3), OF_A_ROBOT] = 0.0
    """Radial lens distortion k₁, at half the picture's width."""
    latency: Annotated[int, Ge(0), Le(MAX_PICTURE_LATENCY)] = 0
    """Latency of the picture, agent steps."""
    ambient: Annotated[float, Ge(0), Le(0.9)] = 0.0
    """Ambient light on the screen, as a share of white."""
    glare: Annotated[float, Ge(0), Le(0.9)] = 0.0
    """Light of a lamp's soft reflection on the screen, at its middle, as a share of white."""
    glare_x: Fraction = 0.5
    """Place of the glare from the projected picture's left (0) to its right edge (1)."""
    glare_y: Fraction = 0.5
    """Place of the glare from the projected picture's upper (0) to its lower edge (1)."""
    brightness: Gain = 1.0
    """Factor of the brightness, as of another exposure."""
    red: Annotated[Gain, OF_A_ROBOT] = 1.0
    """Factor of red."""
    green: Annotated[Gain, OF_A_ROBOT] = 1.0
    """Factor of green."""
    blue: Annotated[Gain, OF_A_ROBOT] = 1.0
    """Factor of blue."""
    gamma: Annotated[float, Ge(0.3), Le(3)] = 1.0
    """Exponent γ of the picture's tones after all gains: above 1 middle tones are darker."""
    dropped: Fraction = 0.0
    """Probability that a picture is lost and the one before is seen again."""
    yaw: Annotated[float, Ge(-45), Le(45), OF_A_ROBOT] = 0.0
    """Turn of the head to its left, degrees from its usual pose."""
    pitch: Annotated[float, Ge(-45), Le(45), OF_A_ROBOT] = 0.0
    """Turn of the head down, degrees from its usual pose."""
    screen_distance: Annotated[float, Ge(0.5), Le(1.5), OF_A_ROBOT] = 1.0
    """Distance of the screen, relative to the usual one."""
    screen_tilt: Annotated[float, Ge(-30), Le(30), OF_A_ROBOT] = 0.0
    """Tilt of the screen's upper edge away from the robot, degrees."""


Law = Callable[[Any, Any, float], float]
"""From a setting's value, its range and a uniform number from 0 to 1: the value in one game. The
extremes are those of 0 and 1."""


def _plus(value: float, most: float, share: float) -> float:
    return value + most * share


def _plus_whole(value: int, most: float, share: float) -> int:
    # Of a range that ends between two numbers, the last one is drawn more seldom than the others.
    return value + min(int((most + 1) * share), ceil(most))


def _less(value: float, most: float, share: float) -> float:
    return value * (1 - most * share)


def _around(value: float, most: float, share: float) -> float:
    return value + most * (2 * share - 1)


def _scaled(value: float, most: float, share: float) -> float:
    return value * (1 + most * (2 * share - 1))


def _multiplied(value: float, most: float, share: float) -> float:
    return value * float(most ** (2 * share - 1))


class Drawn:
    """How settings are drawn from a range.

    Args:
        most: the range of ``--randomise.all``; docs/conditions.md gives its reason.
        settings: what is drawn, each with a number of its own, as ``camera.yaw``.
    """

    def __init__(self, law: Law, most: float, *settings: str) -> None:
        self.law, self.most, self.settings = law, most, settings


@dataclass(frozen=True)
class RandomiseConfig:
    """Conditions that are drawn anew for each game, each one uniformly, around the settings of
    `play` and `camera`. All are off by default; --randomise.all sets those that are not given to
    the ranges of docs/conditions.md. The tests of epochs draw too; --evaluate draws only what its
    own flags say."""

    latency: Annotated[Count, Drawn(_plus_whole, 12, "play.actuation_latency")] = 0
    """Maximum of further actuation latency, emulator frames of 16.7 ms."""
    jitter: Annotated[Count, Drawn(_plus_whole, 2, "play.actuation_jitter")] = 0
    """Maximum of further actuation jitter, emulator frames."""
    arm_speed: Annotated[Amount, Drawn(_less, 0.5, "play.arm_speed")] = 0.0
    """Maximum relative loss of the arms' speed."""
    key_threshold: Annotated[Amount, Drawn(_scaled, 0.3, "play.key_threshold")] = 0.0
    """Maximum relative change of the depths at which keys are pressed and released."""
    sticky: Annotated[Amount, Drawn(_plus, 0.25, "play.sticky")] = 0.0
    """Maximum of further repeat probability."""
    dropped: Annotated[Amount, Drawn(_plus, 0.1, "camera.dropped")] = 0.0
    """Maximum of further probability that a picture is lost."""
    picture_latency: Annotated[Count, Drawn(_plus_whole, 1, "camera.latency")] = 0
    """Maximum of further latency of the picture, agent steps."""
    noise: Annotated[Amount, Drawn(_plus, 8.0, "camera.noise")] = 0.0
    """Maximum of further noise, grey levels of 255."""
    blur: Annotated[Amount, Drawn(_plus, 1.0, "camera.blur")] = 0.0
    """Maximum of further blur, pixels."""
    exposure: Annotated[Amount, Drawn(_scaled, 0.3, "camera.brightness")] = 0.0
    """Maximum relative change of the brightness."""
    colour: Annotated[Amount, Drawn(_scaled, 0.2, "camera.red", "camera.green", "camera.blue")] = (
        0.0
    )
    """Maximum relative change of each colour's gain."""
    gamma: Annotated[float, Ge(1), Drawn(_multiplied, 1.6, "camera.gamma")] = 1.0
    """Maximum factor by which the gamma is multiplied or divided; its logarithm is uniform."""
    ambient: Annotated[Amount, Drawn(_plus, 0.15, "camera.ambient")] = 0.0
    """Maximum of further ambient light, as a share of white."""
    glare: Annotated[Amount, Drawn(_plus, 0.4, "camera.glare")] = 0.0
    """Maximum of further glare, as a share of white, anywhere on the picture."""
    distortion: Annotated[Amount, Drawn(_plus, 0.06, "camera.distortion")] = 0.0
    """Maximum of further radial lens distortion k₁."""
    head_pose: Annotated[Amount, Drawn(_around, 5.0, "camera.yaw", "camera.pitch")] = 0.0
    """Maximum change of the head's yaw and of its pitch, degrees."""
    screen_distance: Annotated[Amount, Drawn(_scaled, 0.15, "camera.screen_distance")] = 0.0
    """Maximum relative change of the screen's distance."""
    screen_tilt: Annotated[Amount, Drawn(_around, 5.0, "camera.screen_tilt")] = 0.0
    """Maximum change of the screen's tilt, degrees."""
    press_latency: Annotated[Count, Drawn(_plus_whole, 3, "play.press_latency")] = 0
    """Maximum of further frames until the modelled hand presses new keys; arms have their own."""


_FIXED = {"play": PlayConfig, "camera": CameraConfig}
DRAWN: dict[str, Drawn] = {
    name: next(each for each in hint.__metadata__ if isinstance(each, Drawn))
    for name, hint in get_type_hints(RandomiseConfig, include_extras=True).items()
}
"""How the settings of each range are drawn, in the order in which they are."""

SETTINGS_OF_A_ROBOT = tuple(
    f"{group}.{name}"
    for group, kind in _FIXED.items()
    for name, hint in get_type_hints(kind, include_extras=True).items()
    if OF_A_ROBOT in getattr(hint, "__metadata__", ())
)

NOTHING_DRAWN = RandomiseConfig()
PERFECT_CAMERA = CameraConfig()
"""A camera without faults, at its usual place."""


class Conditions(NamedTuple):
    """What one game is played under."""

    play: PlayConfig
    camera: CameraConfig


def draw(
    play: PlayConfig,
    camera: CameraConfig,
    ranges: RandomiseConfig,
    random: Callable[[], float],
    share: float = 1.0,
) -> Conditions:
    """Returns the conditions of one game around those of ``play`` and ``camera``.

    As many numbers are drawn whatever is off, so that one range does not change what comes of
    another; none at all if everything is off.

    Args:
        random: draws uniformly from 0 to 1, as `numpy.random.Generator.random`.
        share: of the ranges' widths, 0 to 1.
    """
    if ranges == NOTHING_DRAWN:
        return Conditions(play, camera)
    usual = Conditions(play, camera)._asdict()
    drawn: dict[str, dict[str, Any]] = {group: {} for group in usual}
    glare_x, glare_y = random(), random()
    for name, how in DRAWN.items():
        for setting in how.settings:
            group, field = setting.split(".")
            nothing, whole = getattr(NOTHING_DRAWN, name), getattr(ranges, name)
            most = nothing + share * (whole - nothing)
            drawn[group][field] = how.law(getattr(usual[group], field), most, random())
    if ranges.glare:
        drawn["camera"] |= {"glare_x": glare_x, "glare_y": glare_y}
    return Conditions(replace(play, **drawn["play"]), replace(camera, **drawn["camera"]))


def check_ranges(play: PlayConfig, camera: CameraConfig, ranges: RandomiseConfig) -> None:
    """Refuses ranges that reach beyond the bounds of a setting. Raises InputError with the setting
    at fault."""
    for least_or_most in (lambda: 0.0, lambda: 1.0):
        drawn = draw(play, camera, ranges, least_or_most)
        for group, settings in drawn._asdict().items():
            try:
                from_mapping(type(settings), asdict(settings), group)
            except InputError as error:
                raise InputError(f"in a game that --randomise allows, {error}") from None

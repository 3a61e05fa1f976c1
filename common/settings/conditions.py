"""The conditions of a game: its rules, and the properties of hands and eye.

An environment gets them as plain settings, as if a person had chosen them, and knows nothing of the
ranges from which they may be drawn (`common.settings.ranges`). docs/conditions.md describes all of
them.
"""

from dataclasses import dataclass
from typing import Annotated, Final, Literal, NamedTuple, get_type_hints

import tyro
from annotated_types import Ge, Le

from common.checked import Count, Fraction, LongText
from common.pinned_file import path_of

FRAMES_PER_SECOND = 60
"""Emulator frames in a second of game time."""
MAX_FRAME_STACK = 16
MAX_STARTS = 10_000
MAX_WAIT = 50
MAX_ADDED = 36
"""Maximum added latency, emulator frames; 600 ms."""
MAX_GAP = 12
"""Maximum gap between two keys of hands that are made equal, emulator frames; 200 ms."""
MAX_PICTURE_LATENCY = 3
"""Agent steps."""
MAX_HISTORY = 60
"""Maximum number of commands in the vector observation; 4 s."""

OF_A_ROBOT: Final = "of a robot"
"""Marks a setting of arms, colours or poses, which the emulator's grey picture does not have."""
OF_ARMS: Final = "of arms"
"""Marks a setting of a robot's arms, which a model of hands does not have."""
OF_MODELLED_HANDS: Final = "of modelled hands"
"""Marks a setting of the model of hands, which arms do not have."""

Latency = Annotated[int, Ge(0), Le(60)]
AddedLatency = Annotated[int, Ge(0), Le(MAX_ADDED)]
Gain = Annotated[float, Ge(0.05), Le(2)]


@dataclass(frozen=True)
class LatencyModelSettings:
    """Settings that a latency model declares for itself; its file does not tell them."""

    rate: Literal[30, 60] = 30
    """Commands that it takes per second."""


@dataclass(frozen=True)
class PlayConfig:
    """Game, observation and hands."""  # The defaults are the settings of 2017.

    frame_stack: Annotated[int, Ge(2), Le(MAX_FRAME_STACK)] = 4
    """Number of frames per state."""
    frame_skip: Annotated[int, Ge(1), Le(FRAMES_PER_SECOND)] = 4
    """Number of emulator frames per agent step; 4 at 60 Hz are 66.7 ms."""
    random_starts: Annotated[int, Ge(0), Le(MAX_STARTS)] = 30
    """Maximum number of random actions at the start of a game."""
    minimal_actions: bool = False
    """Action set: the game's own actions (Pong: 6) instead of all 18."""
    max_game_frames: Count = 108_000
    """Length at which a game is truncated, emulator frames (108,000 are 30 minutes); 0 for no
    limit."""
    sticky: Fraction = 0.0
    """Probability, per emulator frame, that the console repeats the previous action, whatever keys
    are pressed (sticky actions, Machado et al. 2018; 0.25 in ALE's v5)."""
    read_keys: Literal["frame", "decision"] = "frame"
    """Reading of the robot's controller: 'frame', before every emulator frame, as a console does;
    'decision', once per agent step, before the arms move, as in 2017."""
    wait_bound: Annotated[int, Ge(1), Le(MAX_WAIT)] = 8
    """Maximum number of agent steps to wait for the commanded keys, with --wait-action."""
    vector: bool = False
    """Proprioception beside the frames: the last commands, the pressed keys, and a robot's
    joints."""
    vector_commands: Annotated[int, Ge(1), Le(MAX_HISTORY)] = 6
    """Number of past commands in --play.vector, one per agent step. A latency can be inferred from
    commands and keys only if both reach that far back."""
    vector_key_frames: Annotated[int, Ge(1), Le(4 * MAX_HISTORY)] = 4
    """Number of past emulator frames whose pressed keys are in --play.vector."""
    vector_joints: bool = True
    """Angles and speeds of a robot's joints in --play.vector. Without them a network fits any
    robot, and the emulator alone."""
    vector_forecast: Annotated[int, Ge(0), Le(MAX_HISTORY)] = 0
    """Number of coming emulator frames whose keys --play.vector forecasts, from the commands so far
    and the latency that the hands have shown."""
    eye: Literal["camera", "emulator"] = "camera"
    """Source of a robot's frames: its camera's picture, or the emulator's own picture."""
    robot: Annotated[str, tyro.conf.arg(aliases=["--robot"])] = "nao"
    """Robot of --env robot: 'nao', 'robotroller', a registered robot, or FILE.npz, which is NAO
    with a latency model in place of its hands, in the format of Physical Atari. The emulator alone
    follows such a model too; of several copies in the file, each game is played by one. The run
    stores the file's SHA-256; each process needs the same file."""
    robot_settings: LongText = ""
    """Settings that a robot declares for itself, such as 'rate=60' of a latency model; the help of
    all flags lists them beside --robot NAME."""
    env_settings: LongText = ""
    """Settings that a registered environment declares for itself, such as 'lamps=4'; the help of
    all flags lists them beside --env NAME."""
    hand: Literal["arm", "model"] = "arm"
    """Actuator of a robot's keys: its arms, or a model with --play.press-latency. The emulator
    alone always uses the model."""
    press_latency: Annotated[Latency, OF_MODELLED_HANDS] = 0
    """Time until the modelled hand presses the keys of a new command, emulator frames; it releases
    the keys of the previous command at once."""
    actuation_latency: AddedLatency = 0
    """Latency added to every command of any hand, arms or model, emulator frames of 16.7 ms; 36 are
    600 ms."""
    actuation_jitter: AddedLatency = 0
    """Maximum random latency added to each command, emulator frames; it is drawn for each command.
    Commands keep their order."""
    equal_latency: AddedLatency = 0
    """Latency to which all hands are slowed, from a picture to the release of keys, emulator
    frames; 0 for none. Keys and eye are timed, and hands that are faster get their commands
    later."""
    equal_gap: Annotated[int, Ge(0), Le(MAX_GAP)] = 0
    """Time from the release of keys to the press of others under --play.equal-latency, emulator
    frames. 0 is as by NAO's hands: one, or two if the hand comes from other keys."""
    hands_model: str = ""
    """File of a latency model of the hands, by which --play.equal-latency plans each command ahead,
    in the format of --robot FILE.npz; it takes 60 commands a second. Without one, each key gets its
    command as soon as its own latency asks for."""
    arm_speed: Annotated[float, Ge(0.25), Le(1.1), OF_A_ROBOT, OF_ARMS] = 1.0
    """Maximum speed of the arms' joints, relative to the usual maximum, which is 0.9 of the
    published speed."""
    key_threshold: Annotated[float, Ge(0.5), Le(1.4), OF_A_ROBOT, OF_ARMS] = 1.0
    """Depths at which a key counts as pressed and as released, relative to the usual ones."""

    @property
    def steps_per_second(self) -> float:
        """Agent steps in a second of game time."""
        return FRAMES_PER_SECOND / self.frame_skip

    @property
    def latency_model(self) -> str | None:
        """The file of the latency model that replaces the hands; None if a robot has its own."""
        return self.robot if path_of(self.robot).suffix == ".npz" else None


@dataclass(frozen=True)
class CameraConfig:
    """Light, camera and pose of the robot's eye; by default it is perfect, in its usual place."""

    noise: Annotated[float, Ge(0), Le(255)] = 0.0
    """Standard deviation of each pixel's noise, grey levels (0 to 255)."""
    blur: Annotated[float, Ge(0), Le(20)] = 0.0
    """Standard deviation of the blur, pixels."""
    distortion: Annotated[float, Ge(0), Le(0.3), OF_A_ROBOT] = 0.0
    """Radial lens distortion k₁, for radii in units of half the picture's width."""
    latency: Annotated[int, Ge(0), Le(MAX_PICTURE_LATENCY)] = 0
    """Latency of the picture, agent steps."""
    ambient: Annotated[float, Ge(0), Le(0.9)] = 0.0
    """Ambient light on the screen, as a share of white."""
    glare: Annotated[float, Ge(0), Le(0.9)] = 0.0
    """Brightness of a lamp's soft reflection on the screen, at its centre, as a share of white."""
    glare_x: Fraction = 0.5
    """Horizontal place of the glare, from the projected picture's left (0) to its right edge
    (1)."""
    glare_y: Fraction = 0.5
    """Vertical place of the glare, from the projected picture's upper (0) to its lower edge (1)."""
    brightness: Gain = 1.0
    """Gain of the whole picture, as by a different exposure."""
    red: Annotated[Gain, OF_A_ROBOT] = 1.0
    """Gain of the red channel."""
    green: Annotated[Gain, OF_A_ROBOT] = 1.0
    """Gain of the green channel."""
    blue: Annotated[Gain, OF_A_ROBOT] = 1.0
    """Gain of the blue channel."""
    gamma: Annotated[float, Ge(0.3), Le(3)] = 1.0
    """Exponent γ of the picture's tones, applied after all gains; above 1, middle tones are
    darker."""
    dropped: Fraction = 0.0
    """Probability that a picture is lost and the previous one is seen again."""
    yaw: Annotated[float, Ge(-45), Le(45), OF_A_ROBOT] = 0.0
    """Turn of the head to the robot's left, degrees from its usual pose."""
    pitch: Annotated[float, Ge(-45), Le(45), OF_A_ROBOT] = 0.0
    """Turn of the head downwards, degrees from its usual pose."""
    screen_distance: Annotated[float, Ge(0.5), Le(1.5), OF_A_ROBOT] = 1.0
    """Distance of the screen, relative to the usual one."""
    screen_tilt: Annotated[float, Ge(-30), Le(30), OF_A_ROBOT] = 0.0
    """Tilt of the screen's upper edge away from the robot, degrees."""


DEFAULT_PLAY = PlayConfig()
PERFECT_CAMERA = CameraConfig()
"""A camera without faults, at its usual place."""


def marked(mark: str) -> tuple[str, ...]:
    """Returns the full names of the settings that have this mark."""
    return tuple(
        f"{group}.{name}"
        for group, kind in {"play": PlayConfig, "camera": CameraConfig}.items()
        for name, hint in get_type_hints(kind, include_extras=True).items()
        if mark in getattr(hint, "__metadata__", ())
    )


class Conditions(NamedTuple):
    """The settings under which one game is played."""

    play: PlayConfig
    camera: CameraConfig
    copy: int = 0
    """Number that chooses one of several copies of the hands in the file of a latency model."""

    @property
    def settings(self) -> dict[str, PlayConfig | CameraConfig]:
        """The settings, by the first part of their full names."""
        return {"play": self.play, "camera": self.camera}

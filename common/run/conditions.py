"""The conditions of one game: what its hands and its eye are like, drawn anew for each game.

`RandomiseConfig` has the ranges. Whoever plays a game gets plain settings, as if somebody had
chosen them, and knows nothing of ranges. docs/conditions.md describes all of them.
"""

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import NamedTuple

from common.errors import InputError
from common.registry import ENVIRONMENTS
from common.run.config import CameraConfig, PlayConfig, RandomiseConfig, RunConfig
from common.run.stored_config import from_mapping

NOTHING_DRAWN = RandomiseConfig()
PERFECT_CAMERA = CameraConfig()
"""A camera without faults, at its usual place."""

_ALL = RandomiseConfig(
    latency=12,  # 200 ms; Physical Atari (arXiv 2606.19357) measured 165 ms from command to game
    jitter=2,  # half an agent step
    arm_speed=0.5,  # the slowest 1 % of presses then take 100 ms instead of 67 ms
    key_threshold=0.3,  # 1.4 to 2.6 mm of 4 mm; a fingertip pushes 3.2 mm deep
    sticky=0.25,  # ALE's v5
    dropped=0.1,
    picture_latency=1,  # 67 ms
    noise=8.0,
    blur=1.0,
    exposure=0.3,
    colour=0.2,
    gamma=1.6,  # 0.625 to 1.6
    ambient=0.15,
    glare=0.4,
    distortion=0.06,
    head_pose=5.0,
    screen_distance=0.15,
    screen_tilt=5.0,
)


class Conditions(NamedTuple):
    """What one game is played under."""

    play: PlayConfig
    camera: CameraConfig


def all_ranges(env: str) -> RandomiseConfig:
    """Returns the ranges of ``--randomise.all``: everything that means something in ``env``."""
    ignored = [name.split(".") for name in ENVIRONMENTS.find(env).ignores]
    off = {name: getattr(NOTHING_DRAWN, name) for group, name in ignored if group == "randomise"}
    return replace(_ALL, **off)


def draw(
    play: PlayConfig, camera: CameraConfig, ranges: RandomiseConfig, random: Callable[[], float]
) -> Conditions:
    """Returns the conditions of one game around those of ``play`` and ``camera``.

    As many numbers are drawn whatever is off, so that one range does not change what comes of
    another; none at all if everything is off.

    Args:
        random: draws uniformly from 0 to 1, as `numpy.random.Generator.random`.
    """
    if ranges == NOTHING_DRAWN:
        return Conditions(play, camera)

    def more(most: float) -> float:
        return most * random()

    def whole(most: int) -> int:
        return min(int((most + 1) * random()), most)

    def about(most: float) -> float:
        return most * (2 * random() - 1)

    anywhere = more(1.0), more(1.0)
    return Conditions(
        replace(
            play,
            actuation_latency=play.actuation_latency + whole(ranges.latency),
            actuation_jitter=play.actuation_jitter + whole(ranges.jitter),
            arm_speed=play.arm_speed * (1 - more(ranges.arm_speed)),
            key_threshold=play.key_threshold * (1 + about(ranges.key_threshold)),
            sticky=play.sticky + more(ranges.sticky),
        ),
        replace(
            camera,
            dropped=camera.dropped + more(ranges.dropped),
            latency=camera.latency + whole(ranges.picture_latency),
            noise=camera.noise + more(ranges.noise),
            blur=camera.blur + more(ranges.blur),
            brightness=camera.brightness * (1 + about(ranges.exposure)),
            red=camera.red * (1 + about(ranges.colour)),
            green=camera.green * (1 + about(ranges.colour)),
            blue=camera.blue * (1 + about(ranges.colour)),
            gamma=camera.gamma * ranges.gamma ** about(1.0),
            ambient=camera.ambient + more(ranges.ambient),
            glare=camera.glare + more(ranges.glare),
            glare_x=anywhere[0] if ranges.glare else camera.glare_x,
            glare_y=anywhere[1] if ranges.glare else camera.glare_y,
            distortion=camera.distortion + more(ranges.distortion),
            yaw=camera.yaw + about(ranges.head_pose),
            pitch=camera.pitch + about(ranges.head_pose),
            screen_distance=camera.screen_distance * (1 + about(ranges.screen_distance)),
            screen_tilt=camera.screen_tilt + about(ranges.screen_tilt),
        ),
    )


def check_conditions(config: RunConfig) -> None:
    """Refuses ranges that reach beyond the bounds of a setting, and what means nothing in the
    environment.

    Raises:
        InputError: with the setting at fault.
    """
    for name in ENVIRONMENTS.find(config.env).ignores:
        group, field = name.split(".")
        value = getattr(getattr(config, group), field)
        usual = getattr(type(getattr(config, group))(), field)
        if value != usual:
            raise InputError(
                f"{name} is {value}, which means nothing in --env {config.env}: leave it at "
                f"{usual:g}."
            )
    for least_or_most in (lambda: 0.0, lambda: 1.0):
        drawn = draw(config.play, config.camera, config.randomise, least_or_most)
        for group, settings in drawn._asdict().items():
            try:
                from_mapping(type(settings), asdict(settings), group)
            except InputError as error:
                raise InputError(f"in a game that --randomise allows, {error}") from None

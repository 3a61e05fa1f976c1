"""The ranges from which each game draws its conditions.

Each field of `RandomiseConfig` is a range around one or more settings of `PlayConfig` and
`CameraConfig`, and says how each game draws them from it.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from math import ceil
from typing import Annotated, Any, get_type_hints

from annotated_types import Ge

from common.checked import Amount, Count
from common.errors import InputError
from common.registry import ENVIRONMENTS
from common.settings.conditions import CameraConfig, Conditions, PlayConfig
from common.settings.stored_config import from_mapping

Law = Callable[[Any, Any, float], float]
"""Returns a setting's value in one game, given its usual value, the width of its range, and a
uniform number from 0 to 1. The extremes are at 0 and 1."""


def _plus(value: float, width: float, uniform: float) -> float:
    return value + width * uniform


def _plus_whole(value: int, width: float, uniform: float) -> int:
    # If a range ends between two whole numbers, its last one is drawn less often than the others.
    return value + min(int((width + 1) * uniform), ceil(width))


def _less(value: float, width: float, uniform: float) -> float:
    return value * (1 - width * uniform)


def _around(value: float, width: float, uniform: float) -> float:
    return value + width * (2 * uniform - 1)


def _scaled(value: float, width: float, uniform: float) -> float:
    return value * (1 + width * (2 * uniform - 1))


def _multiplied(value: float, width: float, uniform: float) -> float:
    return value * float(width ** (2 * uniform - 1))


class Drawn:
    """How settings are drawn from a range.

    Args:
        published: the range of ``--randomise.all``; docs/conditions.md gives the reason.
        settings: the settings that are drawn, such as ``camera.yaw``, each by its own number.
    """

    def __init__(self, law: Law, published: float, *settings: str) -> None:
        self.law, self.published, self.settings = law, published, settings


@dataclass(frozen=True)
class RandomiseConfig:
    """Ranges from which each game draws its conditions, uniformly, around the settings of `play`
    and `camera`. All are off by default; --randomise.all sets every range without a flag of its own
    to that of docs/conditions.md. The test of each epoch draws too; an evaluation draws only what
    its own flags say."""

    actuation_latency: Annotated[Count, Drawn(_plus_whole, 12, "play.actuation_latency")] = 0
    """Maximum additional actuation latency, emulator frames of 16.7 ms."""
    actuation_jitter: Annotated[Count, Drawn(_plus_whole, 2, "play.actuation_jitter")] = 0
    """Maximum additional actuation jitter, emulator frames."""
    arm_speed: Annotated[Amount, Drawn(_less, 0.5, "play.arm_speed")] = 0.0
    """Maximum relative loss of the arms' speed."""
    key_threshold: Annotated[Amount, Drawn(_scaled, 0.3, "play.key_threshold")] = 0.0
    """Maximum relative change of the depths at which keys are pressed and released."""
    sticky: Annotated[Amount, Drawn(_plus, 0.25, "play.sticky")] = 0.0
    """Maximum additional probability of sticky actions."""
    dropped: Annotated[Amount, Drawn(_plus, 0.1, "camera.dropped")] = 0.0
    """Maximum additional probability that a picture is lost."""
    picture_latency: Annotated[Count, Drawn(_plus_whole, 1, "camera.latency")] = 0
    """Maximum additional latency of the picture, agent steps."""
    noise: Annotated[Amount, Drawn(_plus, 8.0, "camera.noise")] = 0.0
    """Maximum additional noise, grey levels (0 to 255)."""
    blur: Annotated[Amount, Drawn(_plus, 1.0, "camera.blur")] = 0.0
    """Maximum additional blur, pixels."""
    exposure: Annotated[Amount, Drawn(_scaled, 0.3, "camera.brightness")] = 0.0
    """Maximum relative change of the brightness."""
    colour: Annotated[Amount, Drawn(_scaled, 0.2, "camera.red", "camera.green", "camera.blue")] = (
        0.0
    )
    """Maximum relative change of the gain of each colour."""
    gamma: Annotated[float, Ge(1), Drawn(_multiplied, 1.6, "camera.gamma")] = 1.0
    """Maximum factor by which γ is multiplied or divided; its logarithm is uniform."""
    ambient: Annotated[Amount, Drawn(_plus, 0.15, "camera.ambient")] = 0.0
    """Maximum additional ambient light, as a share of white."""
    glare: Annotated[Amount, Drawn(_plus, 0.4, "camera.glare")] = 0.0
    """Maximum additional glare, as a share of white, anywhere on the picture."""
    distortion: Annotated[Amount, Drawn(_plus, 0.06, "camera.distortion")] = 0.0
    """Maximum additional radial lens distortion k₁."""
    head_pose: Annotated[Amount, Drawn(_around, 5.0, "camera.yaw", "camera.pitch")] = 0.0
    """Maximum change of the head's yaw, and of its pitch, degrees."""
    screen_distance: Annotated[Amount, Drawn(_scaled, 0.15, "camera.screen_distance")] = 0.0
    """Maximum relative change of the screen's distance."""
    screen_tilt: Annotated[Amount, Drawn(_around, 5.0, "camera.screen_tilt")] = 0.0
    """Maximum change of the screen's tilt, degrees."""
    press_latency: Annotated[Count, Drawn(_plus_whole, 3, "play.press_latency")] = 0
    """Maximum additional --play.press-latency of the modelled hand, emulator frames; arms are not
    affected."""


NOTHING_DRAWN = RandomiseConfig()
DRAWN: dict[str, Drawn] = {
    name: next(each for each in hint.__metadata__ if isinstance(each, Drawn))
    for name, hint in get_type_hints(RandomiseConfig, include_extras=True).items()
}
"""How the settings of each range are drawn, in the order of drawing."""


def draw(
    play: PlayConfig,
    camera: CameraConfig,
    ranges: RandomiseConfig,
    random: Callable[[], float],
    difficulty: float = 1.0,
) -> Conditions:
    """Returns the conditions of one game, drawn around ``play`` and ``camera``.

    The number of draws does not depend on which ranges are off, so one range does not change what
    another draws. Nothing is drawn if every range is off.

    Args:
        random: draws uniformly from 0 to 1, as `numpy.random.Generator.random` does.
        difficulty: share of the ranges' widths that is used, 0 to 1.
    """
    if ranges == NOTHING_DRAWN:
        return Conditions(play, camera)
    usual = Conditions(play, camera).settings
    drawn: dict[str, dict[str, Any]] = {group: {} for group in usual}
    glare_x, glare_y = random(), random()
    for name, how in DRAWN.items():
        for setting in how.settings:
            group, field = setting.split(".")
            nothing, whole = getattr(NOTHING_DRAWN, name), getattr(ranges, name)
            width = nothing + difficulty * (whole - nothing)
            drawn[group][field] = how.law(getattr(usual[group], field), width, random())
    if ranges.glare:
        drawn["camera"] |= {"glare_x": glare_x, "glare_y": glare_y}
    return Conditions(replace(play, **drawn["play"]), replace(camera, **drawn["camera"]))


def check_ranges(play: PlayConfig, camera: CameraConfig, ranges: RandomiseConfig) -> None:
    """Checks that no range reaches beyond the bounds of a setting. Raises InputError with the
    setting at fault."""
    for least_or_most in (lambda: 0.0, lambda: 1.0):
        drawn = draw(play, camera, ranges, least_or_most)
        for group, settings in drawn.settings.items():
            try:
                from_mapping(type(settings), asdict(settings), group)
            except InputError as error:
                raise InputError(f"in a game that --randomise allows, {error}") from None


def all_ranges(env: str) -> RandomiseConfig:
    """Returns the published ranges, of ``--randomise.all``: all that have an effect in ``env``."""
    ignored = ignored_in(env)
    published: dict[str, Any] = {
        name: how.published for name, how in DRAWN.items() if f"randomise.{name}" not in ignored
    }
    return RandomiseConfig(**published)


def ignored_in(env: str) -> list[str]:
    """Returns the settings that have no effect in ``env``, and the ranges around them."""
    fixed = ENVIRONMENTS.find(env).ignores
    ranges = (name for name, how in DRAWN.items() if not set(how.settings).isdisjoint(fixed))
    return [*fixed, *(f"randomise.{name}" for name in ranges)]

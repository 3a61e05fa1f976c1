"""The conditions that a game draws: within their ranges, uniform, one draw for each setting."""

from dataclasses import asdict, fields, replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from annotated_types import Ge, Le
from hypothesis import given
from hypothesis import strategies as st

from common.errors import InputError
from common.registry import ENVIRONMENTS
from common.run.rules import check_config
from common.settings.conditions import PERFECT_CAMERA, CameraConfig, Conditions, PlayConfig
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from common.settings.ranges import NOTHING_DRAWN, RandomiseConfig, all_ranges, check_ranges, draw
from common.settings.stored_config import from_mapping
from tests.paths import ROOT

ALL = all_ranges("robot")

DRAWN = {
    "actuation_latency": ("play.actuation_latency", 0, 12),
    "actuation_jitter": ("play.actuation_jitter", 0, 2),
    "arm_speed": ("play.arm_speed", 0.5, 1.0),
    "key_threshold": ("play.key_threshold", 0.7, 1.3),
    "sticky": ("play.sticky", 0.0, 0.25),
    "dropped": ("camera.dropped", 0.0, 0.1),
    "picture_latency": ("camera.latency", 0, 1),
    "noise": ("camera.noise", 0.0, 8.0),
    "blur": ("camera.blur", 0.0, 1.0),
    "exposure": ("camera.brightness", 0.7, 1.3),
    "colour": ("camera.red camera.green camera.blue", 0.8, 1.2),
    "gamma": ("camera.gamma", 0.625, 1.6),
    "ambient": ("camera.ambient", 0.0, 0.15),
    "glare": ("camera.glare", 0.0, 0.4),
    "distortion": ("camera.distortion", 0.0, 0.06),
    "head_pose": ("camera.yaw camera.pitch", -5.0, 5.0),
    "screen_distance": ("camera.screen_distance", 0.85, 1.15),
    "screen_tilt": ("camera.screen_tilt", -5.0, 5.0),
    "press_latency": ("play.press_latency", 0, 3),
}
"""By range: the settings that it draws, and their least and greatest value by --randomise.all."""


def flat(conditions: Conditions) -> dict[str, Any]:
    return {
        f"{group}.{name}": value
        for group, settings in conditions.settings.items()
        for name, value in asdict(settings).items()
    }


def drawn(ranges: RandomiseConfig, seed: int, base: Conditions | None = None) -> dict[str, Any]:
    base = base or Conditions(PlayConfig(), PERFECT_CAMERA)
    return flat(draw(base.play, base.camera, ranges, np.random.default_rng(seed).random))


USUAL = flat(Conditions(PlayConfig(), PERFECT_CAMERA))


def test_every_range_is_told_here() -> None:
    assert list(DRAWN) == [field.name for field in fields(RandomiseConfig)]
    assert all(value != getattr(NOTHING_DRAWN, name) for name, value in vars(ALL).items())


def test_nothing_is_drawn_where_all_is_off() -> None:
    def none() -> float:
        raise AssertionError

    play, camera = PlayConfig(vector=True), CameraConfig(noise=3.0)
    found = draw(play, camera, NOTHING_DRAWN, none)
    assert found.play is play
    assert found.camera is camera


@pytest.mark.parametrize("name", DRAWN)
def test_a_range_draws_its_settings_alone_and_uniformly(name: str) -> None:
    names, least, most = DRAWN[name]
    ranges = replace(NOTHING_DRAWN, **{name: getattr(ALL, name)})
    games = [drawn(ranges, seed) for seed in range(400)]
    changed = {key for game in games for key in game if game[key] != USUAL[key]}
    place = {"camera.glare_x", "camera.glare_y"} if name == "glare" else set()
    assert changed == set(names.split()) | place
    for setting in names.split():
        values = np.array([game[setting] for game in games])
        if isinstance(least, int):
            counts = np.array([(values == each).sum() for each in range(least, int(most) + 1)])
            assert counts.sum() == 400
            # Chi square: 400 draws are this uneven once in a thousand times.
            expected = 400 / len(counts)
            assert ((counts - expected) ** 2 / expected).sum() < 33 - 15 * (len(counts) < 4)
        else:
            shares = (values - least) / (most - least)
            if name == "gamma":
                shares = np.log(values / least) / np.log(most / least)
            assert 0 <= shares.min() < 0.02
            assert 0.98 < shares.max() <= 1
            # Kolmogorov and Smirnov: 400 draws are this far from uniform once in a thousand times.
            steps = np.arange(1, 401) / 400
            assert np.abs(np.sort(shares) - steps).max() < 1.95 / np.sqrt(400)


def test_draws_of_one_game_have_nothing_to_do_with_each_other() -> None:
    names = [key for settings, *_ in DRAWN.values() for key in settings.split()]
    games = [drawn(ALL, seed) for seed in range(1_500)]
    values = np.array([[game[name] for name in names] for game in games])
    together = np.corrcoef(values.T) - np.eye(len(names))
    assert np.abs(together).max() < 0.12


@pytest.mark.parametrize("name", DRAWN)
def test_a_range_that_is_off_leaves_the_others_as_they_were(name: str) -> None:
    without = drawn(replace(ALL, **{name: getattr(NOTHING_DRAWN, name)}), 5)
    names = DRAWN[name][0].split()
    names += ["camera.glare_x", "camera.glare_y"] if name == "glare" else []
    for key, value in drawn(ALL, 5).items():
        assert without[key] == (USUAL[key] if key in names else value)


def test_a_game_may_be_drawn_from_a_share_of_the_ranges() -> None:
    """Those of half of the ranges are those of ranges half as wide; of none, the usual settings."""
    half = replace(ALL, **{name: value / 2 for name, value in vars(ALL).items()})
    half = replace(half, actuation_latency=6, actuation_jitter=1, gamma=1.3, picture_latency=0)
    base = Conditions(PlayConfig(), PERFECT_CAMERA)
    for seed in range(20):
        found = flat(draw(base.play, base.camera, ALL, np.random.default_rng(seed).random, 0.5))
        expected = drawn(half, seed) | {"camera.latency": found["camera.latency"]}
        assert found == pytest.approx(expected)
        none = flat(draw(base.play, base.camera, ALL, np.random.default_rng(seed).random, 0.0))
        places = ("camera.glare_x", "camera.glare_y")
        assert none | {place: USUAL[place] for place in places} == USUAL


@pytest.mark.parametrize(("most", "share", "shares"), [
    (1, 0.1, [1 / 1.1, 0.1 / 1.1]),
    (1, 0.5, [2 / 3, 1 / 3]),
    (5, 0.5, [2 / 7, 2 / 7, 2 / 7, 1 / 7]),
    (4, 0.5, [1 / 3, 1 / 3, 1 / 3]),
])  # fmt: skip
def test_a_range_of_whole_numbers_grows_without_jumps(
    most: int, share: float, shares: list[float]
) -> None:
    """A range of 2.5 gives 0, 1 and 2 twice as often as 3."""
    base = Conditions(PlayConfig(), PERFECT_CAMERA)
    ranges = RandomiseConfig(actuation_latency=most)
    even = [
        draw(base.play, base.camera, ranges, partial(float, u), share)
        for u in (np.arange(7_000) + 0.5) / 7_000
    ]
    counts = np.bincount([found.play.actuation_latency for found in even]) / 7_000
    assert counts == pytest.approx(shares, abs=1e-3)


def test_draws_are_around_the_settings() -> None:
    base = Conditions(
        PlayConfig(actuation_latency=4, arm_speed=0.8, sticky=0.1),
        CameraConfig(noise=3.0, brightness=0.9, gamma=1.2, yaw=10.0, latency=1),
    )
    games = [drawn(ALL, seed, base) for seed in range(300)]
    for setting, least, most in (
        ("play.actuation_latency", 4, 16),
        ("play.arm_speed", 0.4, 0.8),
        ("play.sticky", 0.1, 0.35),
        ("camera.noise", 3.0, 11.0),
        ("camera.brightness", 0.63, 1.17),
        ("camera.gamma", 0.75, 1.92),
        ("camera.yaw", 5.0, 15.0),
        ("camera.latency", 1, 2),
    ):
        values = [game[setting] for game in games]
        span = most - least
        assert least - 1e-9 <= min(values) <= least + 0.02 * span
        assert most - 0.02 * span <= max(values) <= most + 1e-9


def bounds(name: str, kind: type) -> tuple[Any, Any]:
    hint = kind.__annotations__[name]
    limits = {type(each): each for each in hint.__metadata__}
    return limits[Ge].ge, limits[Le].le


@st.composite
def ranges(draws: st.DrawFn) -> RandomiseConfig:
    """Ranges up to the double of the published ones, of which some reach beyond a bound."""
    values: dict[str, Any] = {}
    for field in fields(RandomiseConfig):
        least: Any = field.default
        number: Any = st.integers if type(least) is int else st.floats
        most = 2 * getattr(ALL, field.name)
        values[field.name] = draws(number(least, most))
    return RandomiseConfig(**values)


@given(ranges(), st.integers(0, 2**32))
def test_what_is_admitted_never_draws_what_is_not(ranges: RandomiseConfig, seed: int) -> None:
    config = RunConfig(randomise=ranges)
    try:
        check_ranges(config.play, config.camera, ranges)
    except InputError:
        return
    found = draw(config.play, config.camera, ranges, np.random.default_rng(seed).random)
    for group, settings in found.settings.items():
        from_mapping(type(settings), asdict(settings), group)


def test_all_ranges_alone_are_within_the_bounds() -> None:
    for name in ("robot", "fast", "paper"):
        preset = PRESETS[name]
        check_config(replace(preset, randomise=all_ranges(preset.env)))


@pytest.mark.parametrize(
    ("base", "ranges", "sentence"),
    [
        (
            {"actuation_latency": 30},
            {"actuation_latency": 7},
            "play.actuation_latency is 37: choose at most",
        ),
        ({"arm_speed": 0.4}, {"arm_speed": 0.5}, "play.arm_speed is 0.2: choose 0.25 or more"),
        ({"key_threshold": 0.6}, {"key_threshold": 0.3}, "play.key_threshold is 0.42: choose 0.5"),
        ({}, {"exposure": 1.0}, "camera.brightness is 0.0: choose 0.05 or more"),
        ({}, {"colour": 1.0}, "camera.red is 0.0: choose 0.05 or more"),
        ({}, {"head_pose": 46.0}, "camera.yaw is -46.0: choose -45 or more"),
        ({}, {"screen_distance": 0.6}, "camera.screen_distance is 0.4: choose 0.5 or more"),
        ({}, {"noise": 256.0}, "camera.noise is 256.0: choose at most 255"),
        ({}, {"exposure": 0.95, "head_pose": 45.0, "screen_distance": 0.5, "noise": 255.0}, ""),
        ({}, {"sticky": 0.5, "picture_latency": 3}, ""),
    ],
)
def test_ranges_that_reach_beyond_a_bound_are_refused(
    base: dict[str, Any], ranges: dict[str, Any], sentence: str
) -> None:
    config = RunConfig(play=PlayConfig(**base), randomise=RandomiseConfig(**ranges))
    if not sentence:
        check_config(config)
        return
    with pytest.raises(InputError, match=f"^in a game that --randomise allows, {sentence}"):
        check_config(config)


def test_all_ranges_of_the_emulator_are_those_that_it_has() -> None:
    found = all_ranges("ale")
    off = {name for name, value in vars(found).items() if value == getattr(NOTHING_DRAWN, name)}
    assert off == {
        *("arm_speed", "key_threshold", "colour", "distortion"),
        *("head_pose", "screen_distance", "screen_tilt"),
    }
    assert replace(found, **{name: getattr(ALL, name) for name in off}) == ALL


def table(heading: str) -> list[list[str]]:
    """Cells of the first table below ``heading`` in docs/conditions.md."""
    text = (ROOT / "docs" / "conditions.md").read_text().partition(f"## {heading}")[2]
    rows = [line for line in text.split("\n## ")[0].splitlines() if line.startswith("| `--")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]


def test_the_page_tells_the_ranges_of_all() -> None:
    told = {
        row[0].strip("`").removeprefix("--randomise.").replace("-", "_"): float(row[2])
        for row in table("Drawn conditions")
    }
    assert told == {name: float(value) for name, value in vars(ALL).items()}


def test_the_page_tells_bounds_and_defaults_of_what_is_fixed() -> None:
    ignored = set(ENVIRONMENTS.find("ale").ignores)
    told = set()
    for flags, _, between, default, ale in table("Fixed conditions"):
        group = flags.split(".")[0].removeprefix("`--")
        names = [flag.split(".")[1].strip("` ") for flag in flags.split(",")]
        for name in (each.replace("-", "_") for each in names):
            kind = {"play": PlayConfig, "camera": CameraConfig}[group]
            least, most = between.replace("−", "-").split(" to ")
            assert bounds(name, kind) == (float(least), float(most))
            assert getattr(kind(), name) == float(default)
            assert (ale == "yes") == (f"{group}.{name}" not in ignored)
            told.add(f"{group}.{name}")
    drawn = {key for settings, *_ in DRAWN.values() for key in settings.split()}
    equal = {"play.equal_latency", "play.equal_gap"}
    assert told == drawn | equal | {"camera.glare_x", "camera.glare_y"}

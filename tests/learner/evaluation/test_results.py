"""What an evaluation's games are summed up to: its JSON and its table."""

import io
import json
import threading
from dataclasses import asdict, replace
from typing import Any

from rich.console import Console

from actors.games import GamesOptions, games
from common.press_latency import COUNTS, Delay, ms_of, place_of
from common.run.config import PlayConfig
from common.run.presets import PRESETS
from learner.evaluation.results import summarise, table
from learner.telemetry.sinks.summary import strict

LATE_KEYS = PlayConfig(
    hand="model",
    release_latency=1,
    press_latency=3,
    eye="emulator",
    random_starts=0,
    max_game_frames=4 * 40,
)


def game(places: dict[int, int]) -> dict[str, Any]:
    key_times = [places.get(place, 0) for place in range(COUNTS)]
    late = {"decisions": 80, "missed_deadlines": 4, "late_frames": 7}
    return {"score": -21.0, "steps": 50, "matched": 40, "valid": 50, **late, "key_times": key_times}


def summed_up(played: list[dict[str, Any]], *flags: str) -> tuple[dict[str, Any], str]:
    about = {"weights": "w", "epsilon": 0.0, "seed": 1, "flags": flags, "changed": []}
    content = summarise(about, played)
    console = Console(width=100, file=io.StringIO(), record=True)
    console.print(table(content))
    told: dict[str, Any] = json.loads(json.dumps(strict(content), allow_nan=False))
    return told, console.export_text()


def test_the_hands_of_all_games_are_summed_up() -> None:
    first = {place_of("release", True, 1): 1, place_of("press", True, 3): 60}
    second = {place_of("release", True, 2): 1, place_of("press", True, 4): 40}
    content, shown = summed_up([game(first), game(second)])
    assert content["press_ms"] == asdict(Delay(100, 50.0, ms_of(4), ms_of(4), 0.0))
    assert content["release_ms"] == asdict(Delay(2, ms_of(1), ms_of(2), ms_of(2), 0.0))
    assert "command to keys, p50/p99 ms" in shown
    assert "release 17/33, press 50/67" in shown


def test_hands_that_never_press_leave_a_gap_in_strict_json() -> None:
    content, shown = summed_up([game({place_of("press", False, 30): 10})])
    assert content["press_ms"] == {
        "measured": 10,
        "p50": None,
        "p99": None,
        "watched": 500.0,
        "given_up": 1.0,
    }
    assert "release –/–, press ∞/∞" in shown


def test_without_hands_there_is_no_row_of_them() -> None:
    content, shown = summed_up([game({}), game({})])
    assert content["press_ms"]["measured"] == 0
    assert "keys as commanded" in shown
    assert "command to keys" not in shown


def test_real_time_tells_how_many_decisions_were_in_time() -> None:
    content, shown = summed_up([game({}), game({})], "--no-sync")
    assert content["deadlines_kept_share"] == 1 - 8 / 160
    assert content["late_frames"] == 14
    assert "95.00%" in shown
    assert "deadlines" not in summed_up([game({})], "--sync")[1]


def test_each_game_tells_what_its_own_hands_took() -> None:
    config = replace(PRESETS["robot"], play=LATE_KEYS)
    options = GamesOptions(weights=None, config="", games=2, epsilon=1.0)  # type: ignore[arg-type]
    found = list(games(config, options, threading.Event()))
    assert [each.steps for each in found] == [40, 40]
    assert found[0].key_times != found[1].key_times
    for each in found:
        changes = sum(each.key_times)
        assert 40 < changes <= 80  # most of 40 random commands among 18 release and press
        reached = {place_of("release", True, 2), place_of("press", True, 4)}
        assert {place for place, count in enumerate(each.key_times) if count} == reached

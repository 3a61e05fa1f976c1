"""What an evaluation's games are summed up to: its JSON and its table."""

import io
import json
import threading
from dataclasses import asdict, replace
from typing import Any

import pytest
from rich.console import Console
from rich.table import Table

from actors.games import GamesOptions, games
from common.press_latency import COUNTS, KeyLatency, ms_of, place_of
from common.settings.clock import ClockConfig
from common.settings.conditions import PlayConfig
from common.settings.presets import PRESETS
from common.strict_json import strict
from learner.evaluation.results import summarise, table

SYNC = ClockConfig()
LATE_KEYS = PlayConfig(
    hand="model",
    press_latency=3,
    eye="emulator",
    random_starts=0,
    max_game_frames=4 * 40,
)


ABOUT = {
    **{"weights": "w", "epsilon": 0.0, "sticky": 0.25, "changed": [], "conditions": []},
    "keys_can_follow": True,
}


def game(places: dict[int, int], whole: str = "1", ending: str = "2") -> dict[str, Any]:
    key_times = [places.get(place, 0) for place in range(COUNTS)]
    late = {"decisions": 80, "missed_deadlines": 4, "late_frames": 7, "key_times": key_times}
    time = {"game_seconds": 6.0, "wall_seconds": 4.0, "game_hash": whole, "ending_hash": ending}
    return {"score": -21.0, "steps": 50, "matched": 40, "valid": 50, "follows": 45, **late, **time}


def printed(shown: Table) -> str:
    console = Console(width=120, file=io.StringIO(), record=True)
    console.print(shown)
    return console.export_text()


def summed_up(
    played: list[dict[str, Any]], clock: ClockConfig = SYNC
) -> tuple[dict[str, Any], str]:
    content = summarise(played, clock)
    told: dict[str, Any] = json.loads(json.dumps(strict(content), allow_nan=False))
    return told, printed(table(ABOUT | content))


def row(shown: str, name: str) -> str:
    """The cell of a table's row called so; empty if there is none."""
    cells = [line.strip("│").split("│") for line in shown.splitlines() if f"│ {name}" in line]
    return cells[0][1].strip() if cells else ""


def test_the_hands_of_all_games_are_summed_up() -> None:
    first = {place_of("release", True, 1): 1, place_of("press", True, 3): 60}
    second = {place_of("release", True, 2): 1, place_of("press", True, 4): 40}
    content, shown = summed_up([game(first), game(second)])
    assert content["press_ms"] == asdict(KeyLatency(100, 50.0, ms_of(4), ms_of(4), 0.0))
    assert content["release_ms"] == asdict(KeyLatency(2, ms_of(1), ms_of(2), ms_of(2), 0.0))
    assert row(shown, "command to keys, p50/p99 ms") == "release 17/33, press 50/67"


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


def test_real_time_tells_how_many_agent_steps_were_in_time() -> None:
    content, shown = summed_up([game({}), game({})], ClockConfig(sync=False))
    assert content["deadlines_kept_share"] == 1 - 8 / 160
    assert (content["late_frames"], content["speed"]) == (14, 1.0)
    assert row(shown, "deadlines kept") == "95.00 %"
    assert row(shown, "late frames") == "14"
    assert row(shown, "game ÷ wall") == "1.50"
    assert row(shown, "time") == "real time"


def test_what_is_not_in_real_time_says_so() -> None:
    content, shown = summed_up([game({}), game({})])
    assert (content["deadlines_kept_share"], content["speed"]) == (None, None)
    assert row(shown, "time") == "not in real time"
    assert not row(shown, "deadlines")
    content, shown = summed_up([game({})], ClockConfig(sync=False, speed=200))
    assert (content["deadlines_kept_share"], content["speed"]) == (0.95, 200)
    assert row(shown, "time") == "real time × 200"
    assert row(shown, "deadlines kept") == "95.00 %"


def test_seconds_of_all_games_are_summed_up() -> None:
    slow = {**game({}), "game_seconds": 2.0, "wall_seconds": 12.0}
    content, shown = summed_up([game({}), slow])
    assert (content["game_seconds"], content["wall_seconds"]) == (8.0, 16.0)
    assert row(shown, "game ÷ wall") == "0.50"
    assert (content["steps"], content["decisions"]) == (100, 160)


def test_hands_that_only_release_are_shown() -> None:
    _, shown = summed_up([game({place_of("release", True, 1): 3})])
    assert row(shown, "command to keys, p50/p99 ms") == "release 17/17, press –/–"


def test_each_figure_is_its_own() -> None:
    """Games of which no two are alike, in no order."""
    scores, steps = [15.0, 9.0, 13.0, 19.0, 29.0], [10, 20, 30, 40, 50]
    played = [
        game({}, whole, ending) | {"score": score, "steps": each}
        for score, each, whole, ending in zip(scores, steps, "abcde", "vwxyz", strict=True)
    ]
    content, shown = summed_up(played)
    assert (content["scores"], content["steps_of_games"]) == (scores, steps)
    assert (content["game_hashes"], content["ending_hashes"]) == (list("abcde"), list("vwxyz"))
    # Squares of the distances from 17: 4, 64, 16, 4 and 144.
    assert row(shown, "mean ± deviation") == "17.00 ± 7.62"
    assert row(shown, "interquartile mean") == "15.67"
    low, high = map(float, row(shown, "its 95 % interval").split(" to "))
    assert 9 < low < 15.67 < high < 29
    assert row(shown, "median") == "15"
    assert row(shown, "least, most") == "9, 29"
    assert row(shown, "every game") == "15 9 13 19 29"


def test_games_that_are_one_game_are_counted_once() -> None:
    played = [game({}, *hashes) for hashes in ("ax", "ax", "bx", "cy", "dz")]
    content, shown = summed_up(played)
    assert (content["games"], content["distinct_games"]) == (5, 4)
    assert (content["distinct_endings"], content["same_ending"]) == (3, 3)
    assert row(shown, "distinct games") == "4"
    assert row(shown, "alike in their last 800 steps") == "3"
    assert row(summed_up([played[0], played[3]])[1], "alike") == "none"


def test_a_headline_has_a_column_for_each_measure() -> None:
    changes = (["env ale → robot"], ["env ale → robot", "play.sticky 0.0 → 0.5"])
    rows = [
        {"epsilon": epsilon, "sticky": sticky, "changed": changed}
        | {"conditions": ["camera.noise 0.0 → 8.0", *changed[1:]], "keys_can_follow": True}
        | summarise([game({}, *hashes), game({}, "c", "x")], ClockConfig(sync=False))
        for epsilon, sticky, hashes, changed in (
            (0.001, 0.0, "ax", changes[0]), (0.05, 0.5, "by", changes[1])
        )
    ]  # fmt: skip
    shown = printed(table({"weights": "w", "rows": rows}))
    assert shown.startswith("w ")
    cells = [
        [cell.strip() for cell in line.strip("│").split("│")]
        for line in shown.splitlines()
        if line.startswith("│")
    ]
    assert cells == [
        ["other than trained", "env ale → robot", "env ale → robot"],
        ["other than trained", "", "play.sticky 0.0 → 0.5"],
        ["other than the preset", "camera.noise 0.0 → 8.0", "camera.noise 0.0 → 8.0"],
        ["random actions ε", "0.001", "0.05"],
        ["sticky actions", "0", "0.5"],
        ["games", "2", "2"],
        ["distinct games", "2", "2"],
        ["alike in their last 800 steps", "2", "none"],
        ["mean ± deviation", "−21.00 ± 0.00", "−21.00 ± 0.00"],
        ["interquartile mean", "−21.00", "−21.00"],
        ["its 95 % interval", "−21.00 to −21.00", "−21.00 to −21.00"],
        ["median", "−21", "−21"],
        ["least, most", "−21, −21", "−21, −21"],
        ["agent steps", "100 (160 passed)", "100 (160 passed)"],
        ["keys as commanded", "80.0 %", "80.0 %"],
        ["frames valid", "100.0 %", "100.0 %"],
        ["time", "real time", "real time"],
        ["game ÷ wall seconds", "1.50", "1.50"],
        ["deadlines kept", "95.00 %", "95.00 %"],
        ["late frames", "14", "14"],
    ]


def test_without_a_robot_its_figures_are_left_out() -> None:
    perfect = {"press_match_share": 1.0, "valid_frame_share": 1.0}
    content = summarise([game({})], SYNC) | ABOUT
    robots = "keys as commanded" in printed(table(content | {"valid_frame_share": 0.5}))
    assert robots
    assert not {"keys", "frames"} & set(printed(table(content | perfect)).split())


def test_hands_whose_keys_cannot_follow_are_told_as_such() -> None:
    content = summarise([game({3: 1})], SYNC) | ABOUT
    late = content | {"keys_can_follow": False}
    assert row(printed(table(late)), "keys as commanded") == "80.0 % (hands are late)"
    assert row(printed(table(content)), "keys as commanded") == "80.0 %"


def test_brackets_in_a_path_or_a_setting_are_shown_as_they_are() -> None:
    change = "play.env_settings  → layers=[a] x=[/b]"
    content = summarise([game({3: 1})], SYNC) | ABOUT | {"weights": "[/w].st", "changed": [change]}
    shown = printed(table(content))
    assert shown.startswith("[/w].st")
    assert row(shown, "other than trained") == change


def test_each_game_tells_what_its_own_hands_took() -> None:
    config = replace(PRESETS["robot"], play=LATE_KEYS)
    options = GamesOptions(
        weights=None,  # type: ignore[arg-type]
        settings="",
        ending=20,
        games=2,
        epsilon=1.0,
    )
    found = list(games(config, options, threading.Event()))
    assert [each["steps"] for each in found] == [40, 40]
    assert [each["game_seconds"] for each in found] == pytest.approx([40 * 4 / 60] * 2)
    assert found[0]["game_hash"] != found[1]["game_hash"]
    assert all(each["wall_seconds"] > 0 for each in found)
    assert found[0]["key_times"] != found[1]["key_times"]
    for each in found:
        changes = sum(each["key_times"])
        assert 40 < changes <= 80  # most of 40 random commands among 18 release and press
        reached = {place_of("release", True, 1), place_of("press", True, 4)}
        assert {place for place, count in enumerate(each["key_times"]) if count} == reached


@pytest.mark.parametrize(("least", "steps", "played"), [(1, 100, 3), (2, 1, 2), (1, 80, 2)])
def test_there_are_enough_games_and_of_their_steps(least: int, steps: int, played: int) -> None:
    """As in the tests of 2017, which played 125,000."""
    play = PlayConfig(random_starts=0, max_game_frames=4 * 40)
    config = replace(PRESETS["fast"], play=play)
    asked = GamesOptions(None, "", 20, games=least, steps=steps, epsilon=1.0)  # type: ignore[arg-type]
    assert len(list(games(config, asked, threading.Event()))) == played

"""What the games of an evaluation come to: one mapping, and the table that shows it."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from rich.table import Table

from common.press_latency import Delay
from learner.evaluation.scores import Scores
from learner.telemetry.provenance import Provenance
from learner.telemetry.sinks import formats as figures


def summarise(about: Mapping[str, Any], games: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Returns the figures of at least one game, as the JSON of an evaluation has them.

    Args:
        about: what was played: its weights, epsilon, seed, flags and changed settings.
        games: what `actors.games` told about each.
    """
    steps = sum(game["steps"] for game in games)
    late = {
        name: sum(game[name] for game in games)
        for name in ("decisions", "missed_deadlines", "late_frames")
    }
    key_times = tuple(map(sum, zip(*(game["key_times"] for game in games), strict=True)))
    return {
        **about,
        **asdict(Scores.of([game["score"] for game in games])),
        "steps": steps,
        "press_ms": asdict(Delay.of(key_times, "press")),
        "release_ms": asdict(Delay.of(key_times, "release")),
        "deadlines_kept_share": 1 - late["missed_deadlines"] / late["decisions"],
        "late_frames": late["late_frames"],
        "press_match_share": sum(game["matched"] for game in games) / steps,
        "valid_frame_share": sum(game["valid"] for game in games) / steps,
        "scores": [game["score"] for game in games],
        "steps_of_games": [game["steps"] for game in games],
        **asdict(Provenance.gather()),
    }


def table(content: Mapping[str, Any]) -> Table:
    """Returns what people read of `summarise`'s figures."""
    shown = Table(title=f"{content['weights']}, ε = {content['epsilon']:g}", title_justify="left")
    shown.add_column("")
    shown.add_column("score", justify="right")
    low, high = content["iqm_low"], content["iqm_high"]
    release, press = (Delay(**content[name]) for name in ("release_ms", "press_ms"))
    hands = ", ".join(
        f"{name} {figures.milliseconds(found.p50)}/{figures.milliseconds(found.p99)}"
        for name, found in (("release", release), ("press", press))
    )
    for name, cell in (
        *(("other than trained", change) for change in content["changed"]),
        ("games", f"{content['games']}"),
        ("mean ± deviation", f"{content['mean']:.2f} ± {content['deviation']:.2f}"),
        ("interquartile mean (95 %)", f"{content['iqm']:.2f} ({low:.2f} to {high:.2f})"),
        ("median", f"{content['median']:g}"),
        ("least, most", f"{content['least']:g}, {content['most']:g}"),
        ("steps", f"{content['steps']:,}"),
        ("keys as commanded", f"{content['press_match_share']:.1%}"),
        *((("command to keys, p50/p99 ms", hands),) if release.measured + press.measured else ()),
        *(
            (("deadlines kept", f"{content['deadlines_kept_share']:.2%}"),)
            if "--no-sync" in content["flags"]
            else ()
        ),
        ("frames valid", f"{content['valid_frame_share']:.1%}"),
        ("every game", " ".join(f"{score:g}" for score in content["scores"])),
    ):
        shown.add_row(name, cell)
    return shown

"""`python -m benchmarks.lab.sight`: measures how well the robot sees.

There are three measurements: the detected corners of the screen against their true places, from
random poses of the camera; the unwarped frame against the emulator's own; and how well a linear
probe reads ball and paddles off the frames.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import tyro
from annotated_types import Ge, MinLen
from numpy.typing import NDArray

from benchmarks.lab.sight_poses import (
    FAULTS,
    PERFECT,
    POSES,
    Look,
    Tally,
    cases,
    measure,
)
from benchmarks.lab.sight_probe import QUANTITIES, collect, probe
from benchmarks.report import BenchmarkOptions, Report, Table, main
from common.atomic_file import check_new_file
from common.checked import FromOne
from common.games import check_game
from viewer import overlay
from viewer.picture import write_picture

MAX_PIXELS = 1.5
MAX_DIFFERENCE = 8.0
_PADDLES, _BALL = 0.98, 0.95
LEAST_EXPLAINED = (_PADDLES, _PADDLES, _BALL, _BALL)
"""Goals: p95 of the corners, pixels; difference on Pong, grey levels; R² of `QUANTITIES`."""

_COLUMNS = 4
_SCALE = 1.5
"""Size of a drawn picture, relative to the camera's."""
_LOST = (255, 160, 0)


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Measure screen detection in the robot's camera pictures."""

    games: Annotated[tuple[str, ...], MinLen(1)] = (
        "pong",
        "breakout",
        "space_invaders",
        "asteroids",
    )
    """Games on the screen."""
    poses: FromOne = 40
    """Number of poses of each camera; every game is seen from each of them."""
    frames: Annotated[int, Ge(200)] = 7_000
    """Number of pictures of Pong for the probe; fewer than two thirds have the ball in play."""
    seed: int = 1
    """Seed of poses, play and faults."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """PNG file of sample pictures with the detected corners."""

    def check(self) -> None:
        super().check()
        for game in self.games:
            check_game(game)
        if self.output is not None:
            check_new_file(self.output)


def page(looks: Sequence[Look]) -> NDArray[np.uint8]:
    """Returns all of ``looks`` with the found corners drawn, ``uint8 [rows, columns, 3]``."""
    pictures = [_drawn(look) for look in looks]
    pictures += [np.zeros_like(pictures[0])] * (-len(pictures) % _COLUMNS)
    rows = [pictures[i : i + _COLUMNS] for i in range(0, len(pictures), _COLUMNS)]
    return np.vstack([np.hstack(row) for row in rows])


def _drawn(look: Look) -> NDArray[np.uint8]:
    large = cv2.resize(look.picture, None, None, _SCALE, _SCALE, cv2.INTER_NEAREST)
    picture = np.asarray(large, np.uint8)
    label = f"{look.case.name} - {look.game}"
    if look.detection.corners is not None:
        overlay.outline(picture, look.detection.corners, _SCALE, overlay.MAGENTA, 1)
    frame = cv2.cvtColor(look.detection.frame, cv2.COLOR_GRAY2RGB)
    picture[-len(frame) :, : frame.shape[1]] = frame
    colour = overlay.MAGENTA if look.detection.valid else _LOST
    picture[:30] = overlay.PAPER
    overlay.write(picture, label, (8, 22), size=0.7, colour=colour)
    return picture


def look_around(options: Options) -> tuple[dict[str, dict[str, Tally]], list[Look]]:
    """Returns the tallies of each case by game, and a first look per case, each at another game."""
    rng, tallies, first = np.random.default_rng(options.seed), {}, []
    for number, case in enumerate(cases()):
        looks: list[Look] = []
        tallies[case.name] = measure(case, options.games, options.poses, rng, looks.append)
        game = options.games[number % len(options.games)]
        first.append(next(look for look in looks if look.game == game))
    return tallies, first


def read_off(options: Options) -> list[dict[str, Any]]:
    """Returns the probe's R² for each source of frames."""
    rows = []
    for title, eye in (("perfect camera", PERFECT), ("all faults", FAULTS)):
        frames = collect(options.frames, eye, options.seed)
        own = {"the emulator itself": frames.own} if eye is PERFECT else {}
        for source, seen in {**own, title: frames.seen}.items():
            found = dict(zip(QUANTITIES, probe(seen, frames.truth).tolist(), strict=True))
            rows.append({"frames from": source, "frames": len(seen), **found})
    return rows


def goals(
    by_case: dict[str, Any], by_game: list[dict[str, Any]], read: list[dict[str, Any]]
) -> dict[str, bool]:
    worst = [row["p95_px"] for row in by_case.values()]
    kept = {"corners": all(p95 is not None and p95 <= MAX_PIXELS for p95 in worst)}
    for row in by_game:
        if row["game"] == "pong":
            found = row["difference"]
            kept["difference"] = found is not None and found <= MAX_DIFFERENCE
    camera = next(row for row in read if row["frames from"] == "perfect camera")
    kept["probe"] = all(
        camera[name] >= least for name, least in zip(QUANTITIES, LEAST_EXPLAINED, strict=True)
    )
    return kept


def measure_sight(options: Options) -> Report:
    cv2.setNumThreads(1)
    tallies, looks = look_around(options)
    by_case = {name: sum(found.values(), Tally()).figures() for name, found in tallies.items()}
    by_game = [
        {
            "game": game,
            **tallies["perfect"][game].figures(),
            "all faults": tallies["all faults"][game].figures()["difference"],
        }
        for game in options.games
    ]
    read = read_off(options)
    kept = goals(by_case, by_game, read)
    if options.output is not None:
        write_picture(options.output, page(looks))
        print(f"wrote {options.output}")
    return Report(
        [
            Table(
                f"Worst corner of each picture, pixels at 320×240; ±{POSES.head_pose:.0f}° yaw and"
                f" pitch, ±{POSES.screen_distance:.0%} distance",
                [_row({"camera": name, **each}, "difference") for name, each in by_case.items()],
            ),
            Table(
                "84×84 frame against the emulator's own, mean absolute difference in grey levels",
                [_row(row, "p50_px", "p95_px", "max_px") for row in by_game],
            ),
            Table(
                "Linear probe from single frames of Pong, R² on later play", [_row(r) for r in read]
            ),
        ],
        {
            "title": "Sight",
            "poses": options.poses,
            "faults": asdict(FAULTS),
            "corners": by_case,
            "games": by_game,
            "probe": read,
            "goals": kept,
        },
        [
            f"goals: corners p95 ≤ {MAX_PIXELS} px, Pong ≤ {MAX_DIFFERENCE:.0f} of 255, "
            f"R² ≥ {_PADDLES} for paddles and ≥ {_BALL} for the ball: "
            + ", ".join(f"{name} {'kept' if well else 'MISSED'}" for name, well in kept.items())
        ],
    )


def _row(figures: dict[str, Any], *without: str) -> dict[str, Any]:
    """Returns a row without some columns, its numbers formatted for people."""

    def cell(name: str, value: Any) -> Any:
        if name == "found":
            return f"{value:.1%}"
        return f"{value:.4f}" if name in QUANTITIES else value

    return {name: cell(name, value) for name, value in figures.items() if name not in without}


if __name__ == "__main__":
    main("lab.sight", Options, measure_sight)

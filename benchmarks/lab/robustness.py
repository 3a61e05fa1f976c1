"""`python -m benchmarks.lab.robustness robot_pong --json FILE`: games in other worlds.

A policy plays in worlds other than its own. Each cell of a grid adds an actuation latency to the
hands and a fault to the eye; nothing is learned. The same command plays the cells that are missing
from FILE, and so continues an interrupted grid. `python -m benchmarks.figures.plot --figure
robustness FILE` draws it as a heat map, or as a curve if there is only one optics, as with

    --optics nominal --latencies 0 4 8 12 16 20 24 30 36
"""

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from annotated_types import Ge, Le, MinLen

from ale_robot.policies import GridScores
from benchmarks.lab.policy import PlayingOptions, evaluate
from benchmarks.quoted_flags import names_of, quoted_flags
from benchmarks.report import Report, Row, Table, main, measure_missing, resumed, scored
from common.atomic_file import write_json
from common.checked import Fraction, FromOne
from common.command_line.played import parse_played
from common.errors import InputError, choice
from common.press_latency import ms_of
from common.registry import ROBOTS
from common.settings.conditions import DEFAULT_PLAY, MAX_ADDED, PERFECT_CAMERA
from learner.evaluation.__main__ import Evaluation
from learner.evaluation.options import EPSILON


class Optics(NamedTuple):
    """A fault of the eye."""

    title: str
    """Its name for people."""
    settings: dict[str, str]


OPTICS = {
    "nominal": Optics("a perfect camera", {}),
    "grain": Optics("noise and blur", {"camera.noise": "8", "camera.blur": "1"}),
    "pose": Optics(
        "head and screen moved",
        {"randomise.head-pose": "5", "randomise.screen-distance": "0.15"},
    ),
    "light": Optics(
        "gamma, ambient light, glare",
        {"randomise.gamma": "1.6", "randomise.ambient": "0.2", "randomise.glare": "0.3"},
    ),
    "late": Optics("pictures lost and late", {"camera.dropped": "0.1", "camera.latency": "1"}),
}
"""Settings of the eye. Noise is in grey levels, the head's pose in degrees; the screen's distance,
ambient light and glare are shares. In "late", 10 % of the pictures are lost and all are one agent
step late."""
_USUAL = {
    **{f"camera.{name}": value for name, value in asdict(PERFECT_CAMERA).items()},
    **{
        f"play.{name}": getattr(DEFAULT_PLAY, name)
        for name in ("actuation_jitter", "arm_speed", "key_threshold")
    },
}
"""What all cells but for their own settings have, so that a cell is the same for all networks."""
_KEPT = (
    "games", "mean", "deviation", "iqm", "iqm_low", "iqm_high", "least", "most", "distinct_games",
    "distinct_endings", "steps", "scores", "press_match_share",
    "valid_frame_share", "git_commit", "git_dirty",
)  # fmt: skip

_LATENCIES = (0, 2, 4, 8, 12)
_OWN = ("--seed", "--games", "--epsilon", "--json", "--headline")
"""Flags of an evaluation that the grid gives, beside those of its cells."""


@dataclass(frozen=True)
class Options(PlayingOptions):
    """Play whole games by a trained network under added latencies and faults of the eye."""

    latencies: Annotated[tuple[Annotated[int, Ge(0), Le(MAX_ADDED)], ...], MinLen(1)] = _LATENCIES
    """Added actuation latencies, emulator frames of 16.7 ms: 0, 33, 67, 133 and 200 ms."""
    optics: Annotated[tuple[str, ...], MinLen(1)] = tuple(OPTICS)
    """Optics: faults of the eye, which docs/conditions.md describes."""
    sticky: Fraction = 0.0
    """Probability of the console's sticky actions."""
    robot: str | None = None
    """Robot that plays, instead of the policy's own."""
    seed: FromOne = 1
    """Seed of the games."""
    flags: str = ""
    """More flags of each evaluation, as in --flags="--play.equal-latency 17"."""
    card: bool = False
    """Also write mean and worst of the grid into the network's card, for `ale-robot policies`."""

    def check(self) -> None:
        super().check()
        if self.robot is not None:
            ROBOTS.find(self.robot)
        for name in self.optics:
            if name not in OPTICS:
                raise InputError(f"there is no optics {name!r}: {choice(name, [*OPTICS])}")
        own = {*names_of(cell_flags(0, "nominal", 0.0, "nao")), "--robot", *_OWN}
        quoted_flags(self.flags, "--flags", own)
        grid = self.latencies, self.optics, self.sticky, self.robot, self.flags, self.epsilon
        if self.card and grid != (_LATENCIES, tuple(OPTICS), 0.0, None, "", EPSILON):
            raise InputError(
                "--card needs the whole grid with the policy's own robot: omit --latencies, "
                "--optics, --sticky, --robot, --flags, --epsilon."
            )
        if self.card and not self.network.with_suffix(".json").is_file():
            raise InputError(
                f"{self.network} has no card: publish it by python -m learner.publish, or omit "
                "--card."
            )
        self._check_cells()

    def _check_cells(self) -> None:
        """Refuses optics of which the network's environment knows nothing, before any game."""
        refused: dict[str, InputError] = {}
        for optics in self.optics:
            try:
                self.evaluation(optics, max(self.latencies)).check()
            except InputError as error:
                refused[optics] = error
        if refused:
            first, why = next(iter(refused.items()))
            if not (left := [name for name in self.optics if name not in refused]):
                raise why
            raise InputError(
                f"the network cannot play --optics {first} ({f'{why}'.removesuffix('.')}): give "
                f"--optics {' '.join(left)}."
            )

    def evaluation(self, optics: str, latency: int) -> Evaluation:
        """Returns the evaluation of a cell."""
        flags = [f"{self.network}", *self.cell_flags(optics, latency)]
        return parse_played(Evaluation, "learner.evaluation", flags)

    def cell_flags(self, optics: str, latency: int) -> list[str]:
        """Returns the flags of a cell's evaluation."""
        cell = cell_flags(latency, optics, self.sticky, self.robot)
        return [*cell, *quoted_flags(self.flags, "--flags"), "--seed", f"{self.seed}"]


def cell_flags(latency: int, optics: str, sticky: float, robot: str | None = None) -> list[str]:
    """Returns the flags of an evaluation in a cell of the grid."""
    settings = {
        **({} if robot is None else {"play.robot": robot}),
        **{name.replace("_", "-"): f"{value}" for name, value in _USUAL.items()},
        **OPTICS[optics].settings,
        "play.actuation-latency": f"{latency}",
        "play.sticky": f"{sticky:g}",
    }
    return [part for name, value in settings.items() for part in (f"--{name}", value)]


def measure(options: Options) -> Report:
    sha256 = hashlib.sha256(options.network.read_bytes()).hexdigest()
    player = options.network.stem
    if options.robot is not None:
        player += f" by {options.robot}"
    played = options.evaluation(options.optics[0], options.latencies[0]).config().play
    about = {
        "title": f"robustness of {player}",
        "network": player,
        "sha256": sha256,
        "epsilon": options.epsilon,
        "sticky": options.sticky,
        "games": options.games,
        "seed": options.seed,
        "flags": options.flags,
        # With the hash of each file's content.
        "latency_model": played.latency_model or "",
        "hands_model": played.hands_model,
    }
    found = resumed(
        options.json, about, "grid of this network, robot, games, ε, sticky, seed and flags"
    )
    found.pop("rows", None)  # the old rows have fewer cells
    found["cells"] = _current(found.get("cells", []), options.json)
    asked = [(optics, late) for optics in options.optics for late in options.latencies]
    places = [{"optics": optics, "latency": late} for optics, late in asked]
    cells = measure_missing(options.json, found, "cells", places, partial(_play, options))
    grid = {(cell["optics"], cell["latency"]): cell for cell in cells}
    rows = [
        {
            "optics": optics,
            **{
                f"+{ms_of(cell['latency']):.0f} ms": scored(cell)
                for cell in (grid[optics, latency] for latency in options.latencies)
            },
        }
        for optics in options.optics
    ]
    found["rows"] = rows
    means = [grid[place]["mean"] for place in asked]
    if options.card:
        told = GridScores(
            worlds=len(means),
            games=options.games,
            mean=round(sum(means) / len(means), 4),
            worst=min(means),
            added_ms=ms_of(max(options.latencies)),
        )
        _add_to_card(options.network, told, sha256)
    title = (
        f"{player}: mean ± deviation of {options.games} games a cell, "
        f"ε = {options.epsilon:g}, sticky {options.sticky:g}"
    )
    note = f"mean of all cells {sum(means) / len(means):.2f}, worst {min(means):.2f}"
    return Report([Table(title, rows)], found, (note,))


def _current(cells: Any, file: Path | None) -> list[Row]:
    """Returns those cells of a file that have the present settings of their optics; older files do
    not tell. Raises InputError if they are no cells."""
    now = {name: optics.settings for name, optics in OPTICS.items()}
    try:
        for cell in cells:
            scored(cell), cell["latency"]  # what the table needs
        return [
            cell
            for cell in cells
            if (settings := now.get(cell["optics"])) is not None
            and cell.get("settings", settings) == settings
        ]
    except (TypeError, KeyError, ValueError) as error:
        raise InputError(
            f"{file} holds no cells of a grid ({error!r}): name another file."
        ) from None


def _play(options: Options, optics: str, latency: int) -> Row:
    flags = options.cell_flags(optics, latency)
    told = evaluate(options.network, options.games, options.epsilon, flags)
    what = {"added_ms": ms_of(latency), "settings": OPTICS[optics].settings}
    return what | {name: told[name] for name in _KEPT}


def _add_to_card(network: Path, grid: GridScores, sha256: str) -> None:
    file = network.with_suffix(".json")
    card = json.loads(file.read_bytes())
    if card.get("sha256") != sha256:
        raise InputError(f"{file} is not the card of {network.name}: publish that again.")
    card["grid"] = grid._asdict()
    write_json(file, card)


if __name__ == "__main__":
    main("lab.robustness", Options, measure)

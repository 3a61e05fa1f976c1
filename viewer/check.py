"""`python -m viewer check`: health checks of sight and touch, latencies and a picture.

The bounds are those of a run's health checks (`common.metrics`); no learner is needed.
"""

import threading
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import tyro
from rich.console import Console
from rich.table import Column, Table

from actors.envs.checked import CheckedEnv
from actors.envs.robot import RobotEnv
from actors.loop import Step, play, seeds_of
from actors.robots.latency import CHANGES, GOAL, Change, Latency, changes
from actors.vision.layout import border_of
from common.command_line.played import Played
from common.counted import counted
from common.exit_codes import INTERRUPTED
from common.metrics import KEYS_AS_COMMANDED, PIXEL_DEVIATION, VALID_FRAMES, Bound
from common.process.progress import Progress
from common.settings.conditions import PlayConfig
from common.settings.hands import keys_can_follow
from viewer.panels import Panels
from viewer.picture import check_picture, write_picture
from viewer.player import File, ShownPolicy, shown_env

AGENT_STEPS = 200
MAX_CORNER_ERROR = 1.5
"""Maximum error of a corner, camera pixels."""
CORNERS_IN_PLACE = Bound(
    f"corners within {MAX_CORNER_ERROR:g} px", "≥", 0.99, "what is found is not the screen"
)
_BOUNDS = (PIXEL_DEVIATION, VALID_FRAMES, CORNERS_IN_PLACE, KEYS_AS_COMMANDED)
"""Bounds on the means of `_figures`, in the same order."""
_HAIR = 1.001
"""Tolerance factor, because times of frames are not exact in binary."""


@dataclass(frozen=True)
class Check(Played):
    """Check a robot's sight and touch in 200 random agent steps.

    It prints health checks and the hands' latencies, and writes a picture of four panels.
    """

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FILE.png")] = Path("check.png")
    """File of the picture."""
    nao_urdf: File = None
    """URDF of another NAO, with meshes, to show in the picture; the physics stay the same."""

    def check(self) -> None:
        self.config()
        check_picture(self.output)

    def run(self, stop: threading.Event) -> int:
        """Runs the check; returns the exit status, `INTERRUPTED` without a verdict if ``stop`` was
        set. Raises InputError if the NAO of --nao-urdf cannot be shown."""
        config = self.config()
        console = Console(highlight=False)
        with (
            shown_env(config) as env,
            closing(Panels(env, self.nao_urdf)) as panels,
        ):
            policy_seed, env_seed = seeds_of(config.seed)
            policy = ShownPolicy.of_file(config, None, 1.0, policy_seed)
            figures, games = [], 0
            with Progress("checking", AGENT_STEPS) as progress:
                for step in play([env], policy, [env_seed]):
                    figures.append(_figures(step, env))
                    games += step.info.game_over
                    progress.update(len(figures), note=f"{len(figures)} steps")
                    if len(figures) == AGENT_STEPS or stop.is_set():
                        break
            if stop.is_set():
                console.print(f"stopped after {len(figures)} of {AGENT_STEPS} agent steps")
                return INTERRUPTED
            write_picture(self.output, panels.draw(step, None))
            # An emulator alone has only the first figure.
            judged = list(zip(_BOUNDS, np.mean(figures, axis=0).tolist(), strict=False))
            judged = [(bound, found) for bound, found in judged if _can_tell(bound, config.play)]
            title = f"{config.played}, {len(figures)} random agent steps"
            console.print(_checks_table(judged, title))
            if isinstance(env, CheckedEnv):
                console.print(
                    "Actions, states and rewards are as a replay needs them; "
                    f"{counted(games, 'game')} ended within these steps."
                )
            if isinstance(env, RobotEnv) and (found := _changes(env, config.seed, stop)):
                console.print(_latency_table(found))
                if config.play.hand == "model" or not keys_can_follow(config.play):
                    console.print(
                        "These are the robot's own hands; what delays commands or reads the keys "
                        "another way is not in it."
                    )
            console.print(f"wrote {self.output}", markup=False, soft_wrap=True)
        if stop.is_set():
            console.print("stopped before the hands were timed")
            return INTERRUPTED
        return 0 if all(bound.admits(found) for bound, found in judged) else 1


def _can_tell(bound: Bound, play: PlayConfig) -> bool:
    """Returns whether a figure tells something under these settings."""
    if bound is KEYS_AS_COMMANDED:
        return keys_can_follow(play)
    return play.eye == "camera" or bound is PIXEL_DEVIATION


def _changes(env: RobotEnv, seed: int, stop: threading.Event) -> list[Change]:
    """Measures and returns changes of the keys; none if ``stop`` was set."""
    found = []
    with Progress("timing the hands", CHANGES) as progress:
        for change in changes(env.robot, 1, seed):
            if stop.is_set():
                return []
            found.append(change)
            progress.update(len(found), note=f"{len(found)} changes")
    return found


def _figures(step: Step, env: gymnasium.Env[Any, Any]) -> list[float]:
    """Returns the figures of a step: the deviation of its frame's pixels; and of a robot, whether
    the screen was found, whether it was found in the right place, and whether the keys are as
    commanded."""
    deviation = float(step.s_t[-1].std())
    if not isinstance(env, RobotEnv):
        return [deviation]
    return [deviation, step.info.valid_frame, _corners_in_place(env), step.info.keys_match]


def _corners_in_place(env: RobotEnv) -> bool:
    """Returns whether the detector found the corners where the room's geometry puts them."""
    if env.detection.corners is None or not env.detection.valid:
        return False
    truth = env.robot.true_corners()
    if truth is None:  # unknown, as in a real room
        return True
    return bool(np.abs(border_of(env.detection.corners) - truth).max() <= MAX_CORNER_ERROR)


def _checks_table(judged: list[tuple[Bound, float]], title: str) -> Table:
    table = Table(
        "health check",
        Column("found", justify="right"),
        Column("bound", justify="right"),
        "",
        title=title,
        title_justify="left",
    )
    for bound, found in judged:
        verdict = "[green]green[/]" if bound.admits(found) else f"[red]red: {bound.why}[/]"
        table.add_row(bound.check, f"{found:.3g}", str(bound), verdict)
    return table


def _latency_table(found: list[Change]) -> Table | str:
    groups = {
        "from held keys": [change for change in found if change.settled],
        "in play": [change for change in found if not change.settled],
    }
    if not all(any(change.frames for change in group) for group in groups.values()):
        return "[red]the hands never press the commanded keys[/]"
    table = Table(
        "",
        *(Column(heading, justify="right") for heading in (*groups, "goal")),
        title=f"command → keys, {len(found)} changes",
        title_justify="left",
    )
    latencies = [Latency.of(group) for group in groups.values()]
    rows: list[tuple[str, Callable[[Latency], float], str]] = [
        ("p50", lambda latency: latency.p50_ms, "{:.1f} ms"),
        ("p99", lambda latency: latency.p99_ms, "{:.1f} ms"),
        ("not reached", lambda latency: latency.unreached, "{:.0f}"),
        ("over a stray key, %", lambda latency: 100 * latency.stray_share, "{:.1f}"),
    ]
    for name, figure, shown in rows:
        goal = figure(GOAL)
        cells = [
            f"[{'green' if cell <= goal * _HAIR else 'yellow'}]{shown.format(cell)}[/]"
            for cell in map(figure, latencies)
        ]
        table.add_row(name, *cells, f"≤ {shown.format(goal)}")
    return table

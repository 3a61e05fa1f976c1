"""`python -m actors --check`: health checks of sight and touch, latencies and a picture."""

import threading
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from actors.envs import make_env
from actors.envs.ale import AtariEnv
from actors.envs.robot import RobotEnv
from actors.loop import Step, play
from actors.robots.nao.latency import AGENT_STEP_MS, MOST_STRAYS, Change, Latency, changes
from common.errors import InputError
from common.run.config import RunConfig
from viewer.health_checks import MOST_CORNER_ERROR, Check, judge
from viewer.observer import Observer
from viewer.panels import border_of, draw_panels
from viewer.player import ShownPolicy

AGENT_STEPS = 200
_HAIR = 1.001
"""Times of frames are not exact in binary."""


def check(
    config: RunConfig,
    output: Path,
    *,
    nao_urdf: Path | None,
    seed: int,
    stop: threading.Event,
    console: Console | None = None,
) -> int:
    """Play `AGENT_STEPS` random agent steps and judge them; 0 if all health checks pass, else 1.

    Raises:
        InputError: the picture cannot be written, the user's robot not shown.
    """
    console = console or Console(highlight=False)
    env = make_env(config, training=False)
    assert isinstance(env, (RobotEnv, AtariEnv))
    observer = None
    try:
        observer = Observer(env, config.play, nao_urdf)
        actions = int(env.action_space.n)  # type: ignore[attr-defined]
        policy = ShownPolicy.of_file(config, actions, None, 1.0, seed)
        observed = _Observed()
        for step in play([env], policy, [seed]):
            observed.add(step, env)
            if observed.steps == AGENT_STEPS or stop.is_set():
                break
        _write_picture(output, draw_panels(observer.look(step, None)))
        checks = observed.checks(robot=isinstance(env, RobotEnv))
        title = f"{config.game} ({config.env}), {observed.steps} random agent steps"
        console.print(_checks_table(checks, title))
        if isinstance(env, RobotEnv):
            console.print(_latency_table(list(changes(env.robot, 1, seed))))
        console.print(f"wrote {output}", soft_wrap=True)
    finally:
        if observer is not None:
            observer.close()
        env.close()
    return 0 if all(each.green for each in checks) else 1


class _Observed:
    """What the agent steps came to."""

    def __init__(self) -> None:
        self.steps = 0
        self._deviations: list[float] = []
        self._valid = self._in_place = self._matched = 0

    def add(self, step: Step, env: RobotEnv | AtariEnv) -> None:
        self.steps += 1
        self._deviations.append(float(step.s_t[-1].std()))
        self._valid += step.info.valid_frame
        self._matched += step.info.keys_match
        if isinstance(env, RobotEnv):
            self._in_place += _corners_in_place(env)

    def checks(self, *, robot: bool) -> list[Check]:
        """The judgement; the last three figures are a robot's."""
        return judge(
            pixel_deviation=float(np.mean(self._deviations)),
            valid_share=self._valid / self.steps if robot else None,
            corners_share=self._in_place / self.steps if robot else None,
            match_share=self._matched / self.steps if robot else None,
        )


def _corners_in_place(env: RobotEnv) -> bool:
    """Whether the detector has the picture's corners where the room's geometry puts them."""
    if env.detection.corners is None or not env.detection.valid:
        return False
    truth = env.robot.true_corners()
    if truth is None:  # of a real room, say
        return True
    return bool(np.abs(border_of(env.detection.corners) - truth).max() <= MOST_CORNER_ERROR)


def _write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        encoded, content = cv2.imencode(path.suffix or ".png", picture[:, :, ::-1])
        assert encoded
        path.write_bytes(content.tobytes())
    except cv2.error:
        raise InputError(f"{path} is no picture's name: let it end in .png.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}.") from None


def _checks_table(checks: list[Check], title: str) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column("health check")
    table.add_column("found", justify="right")
    table.add_column("at least", justify="right")
    table.add_column("")
    for each in checks:
        verdict = "[green]green[/]" if each.green else f"[red]red: {each.meaning}[/]"
        table.add_row(each.name, f"{each.value:.3g}", f"{each.least:g}", verdict)
    return table


def _latency_table(found: list[Change]) -> Table | str:
    groups = {
        "from held keys": [change for change in found if change.settled],
        "in play": [change for change in found if not change.settled],
    }
    if not all(any(change.frames for change in group) for group in groups.values()):
        return "[red]the hands never reach the keys that they are told to press[/]"
    columns = [(name, Latency.of(group)) for name, group in groups.items()]
    table = Table(title=f"command → keys, {len(found)} changes", title_justify="left")
    table.add_column("")
    for name, _ in columns:
        table.add_column(name, justify="right")
    table.add_column("goal", justify="right")
    rows: list[tuple[str, Callable[[Latency], float], float, str]] = [
        ("p50", lambda latency: latency.p50_ms, AGENT_STEP_MS, "{:.1f} ms"),
        ("p99", lambda latency: latency.p99_ms, 2 * AGENT_STEP_MS, "{:.1f} ms"),
        ("not reached", lambda latency: latency.unreached, 0, "{:.0f}"),
        ("over a stray key", lambda latency: latency.stray_share, MOST_STRAYS, "{:.1%}"),
    ]
    for name, figure, goal, shown in rows:
        cells = [figure(latency) for _, latency in columns]
        table.add_row(
            name,
            *(
                f"[{'green' if cell <= goal * _HAIR else 'yellow'}]{shown.format(cell)}[/]"
                for cell in cells
            ),
            f"≤ {shown.format(goal)}",
        )
    return table

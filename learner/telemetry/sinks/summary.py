"""``summary.json``: what a run has come to, in one file that other programs can read.

Strict JSON: a figure that is unknown, infinite or not a number is null.
"""

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

from common.run.config import RunConfig
from common.run.folder import write_atomically
from common.run.presets import PRESETS
from learner.telemetry.provenance import Provenance
from learner.telemetry.status import ClockMode, Status

_SECONDS_PER_DAY = 86_400
_REPORT = PRESETS["paper"].protocol
"""Its epochs are the unit of ``epochs_per_day``, whatever the run's own length."""


def epochs_per_day(
    epoch_steps: int,
    test_steps: int,
    train_steps_per_second: float | None,
    test_steps_per_second: float | None,
) -> float | None:
    """Epochs of training, then testing, that fit in a day at these measured rates.

    One after the other, as in 2017, so that the figure compares with that experiment's 40 (ALE-
    Only) and 2 to 4 (ALE-Robot) a day. Here evaluators play while training goes on, so a run does
    no fewer than this when both rates were measured side by side. None where a needed rate is
    unknown or 0.
    """
    seconds = 0.0
    for steps, rate in (
        (epoch_steps, train_steps_per_second),
        (test_steps, test_steps_per_second),
    ):
        if steps == 0:
            continue
        if not rate:
            return None
        seconds += steps / rate
    return _SECONDS_PER_DAY / seconds if seconds else None


def write_summary(
    path: Path,
    status: Status,
    config: RunConfig,
    provenance: Provenance,
    clock: ClockMode | None,
    *,
    initial: bool,
    train_steps_per_second: float | None,
    test_steps_per_second: float | None,
) -> None:
    """Write the run's summary to ``path``, atomically.

    Args:
        clock: None where actors were started elsewhere, each in a mode of its own.
        initial: the run began with a network that was given.
        train_steps_per_second: measured over the finished training phases, all actors together;
            written as ``steps_per_second``. None before the first: the status' own then stands in.
        test_steps_per_second: measured over all tests, all evaluators together. Of both rates
            come ``epochs_per_day``.
    """
    if train_steps_per_second is None:
        train_steps_per_second = status.steps_per_second
    summary = {
        "run": status.run,
        "preset": status.preset,
        "env": status.env,
        "game": status.game,
        "seed": config.seed,
        "initial": initial,
        "sync": clock.sync if clock else None,
        "wait_action": clock.wait_action if clock else None,
        "speed": clock.speed if clock else None,
        "device": status.device,
        "wall_seconds": status.elapsed,
        "agent_steps": status.agent_steps,
        "updates": status.updates,
        "epoch": status.epoch,
        "games": status.games,
        "random_reward": status.random_reward,
        "train_reward": status.train_reward,
        "test_reward": status.test_reward,
        "test_epoch": status.test_epoch,
        "best_test_reward": max(status.test_history, default=None),
        "epsilon": status.epsilon,
        "loss": status.loss,
        "mean_max_q": status.mean_max_q,
        "held_out_std": status.held_out_std,
        "samples_per_insert": status.samples_per_insert,
        "samples_per_insert_goal": status.samples_per_insert_goal,
        "stored": status.stored,
        "capacity": status.capacity,
        "replay_process": {
            "private_bytes": status.replay_private_bytes,
            "resident_bytes": status.replay_resident_bytes,
            "file_bytes": status.replay_file_bytes,
        },
        "chunks": dataclasses.asdict(status.chunks),
        "weights_version": status.weights_version,
        "staleness_updates": {"p50": status.staleness_p50, "p95": status.staleness_p95},
        "steps_per_second": train_steps_per_second,
        "test_steps_per_second": test_steps_per_second,
        "updates_per_second": status.updates_per_second,
        "epochs_per_day": epochs_per_day(
            _REPORT.epoch_steps,
            _REPORT.test_steps,
            train_steps_per_second,
            test_steps_per_second,
        ),
        "valid_frame_share": status.valid_frame_share,
        "press_match_share": status.press_match_share,
        "press_ms": dataclasses.asdict(status.press_in_all),
        "release_ms": dataclasses.asdict(status.release_in_all),
        # More than 1 where robots wait, or are late.
        "decisions_per_step": (
            status.time.decisions / status.time.steps if status.time.steps else None
        ),
        "missed_deadlines": status.time.missed_deadlines,
        "late_frames": status.time.late_frames,
        "waits_given_up": status.time.waits_given_up,
        "gates": [dataclasses.asdict(gate) for gate in status.gates],
        "actors": [dataclasses.asdict(actor) for actor in status.actors],
        "config": dataclasses.asdict(config),
        **dataclasses.asdict(provenance),
    }
    text = json.dumps(strict(summary), indent=2, ensure_ascii=False, allow_nan=False)
    write_atomically(path, (text + "\n").encode())


def strict(value: Any) -> Any:
    """``value`` with null for every number that JSON does not have."""
    if isinstance(value, dict):
        return {name: strict(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [strict(inner) for inner in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value

"""`python -m benchmarks.lab.press_latency` on hands that always take two frames."""

import json
from pathlib import Path

import numpy as np
import pytest

from actors.robots.latency import Change
from benchmarks import report
from benchmarks.lab import press_latency
from common.actions import KEYS_OF_ACTION
from common.errors import InputError
from common.registry import ROBOTS, RobotKind
from tests.actors.robots.late_hands import LateHands
from tests.extending.whole_run import added


def run(*flags: str) -> None:
    late = LateHands(2, never=[KEYS_OF_ACTION[15]])  # "up left fire"
    with added(ROBOTS, RobotKind("late", lambda *_: late, joints=0)):
        report.run(
            "lab.press_latency",
            press_latency.Options,
            press_latency.measure,
            ["--repetitions", "1", "--robot", "late", *flags],
        )


def test_table_and_json(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    results = tmp_path / "latency.json"
    run("--json", str(results))
    printed = capsys.readouterr().out
    assert printed.count("│ 33") + printed.count("│33") > 200
    assert "34 not reached" in printed
    assert "missed" in printed
    found = json.loads(results.read_text())
    assert found["p50_ms"] == found["p99_ms"] == pytest.approx(1000 / 30)
    assert found["robot"] == "late"
    assert found["unreached"] == 34  # from 17 actions, settled and not
    assert found["stray_share"] == 0.0
    assert found["frame_ms"] == pytest.approx(1000 / 60)
    assert found["changes"] == 612
    assert found["from_held_keys"]["changes"] == found["in_play"]["changes"] == 306
    assert [found["actions"][action] for action in (0, 1, 2, 14, 17)] == [
        "·",
        "F",
        "U",
        "URF",
        "DLF",
    ]
    table = found["table_ms"]
    assert [len(row) for row in table] == [18] * 18
    assert all(table[action][action] is None for action in range(18))
    assert table[3][4] == pytest.approx(1000 / 30)
    assert table[3][15] is None
    assert found["versions"]["pybullet"]


def test_tables_by_hand() -> None:
    found = [Change(0, 1, True, frames, False) for frames in (1, 2, 2, 9)]
    found += [Change(1, 0, False, 3, True), Change(2, 0, False, None, True)]
    median, worst = press_latency.tables(found)
    assert (median[0, 1], worst[0, 1]) == pytest.approx((1000 / 30, 150.0))
    assert median[1, 0] == worst[1, 0] == pytest.approx(50.0)
    assert np.count_nonzero(~np.isnan(median)) == np.count_nonzero(~np.isnan(worst)) == 2


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (["--repetitions", "0"], "repetitions"),
        (["--seed", "-1"], "seed"),
        (["--json", "/dev/null/latency.json"], "cannot be written"),
        (["--robot", "atlas"], "no robot 'atlas'"),
    ],
)
def test_settings_that_cannot_work(flags: list[str], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        run(*flags)

"""The speed benchmark: what it counts, and that its parts add up."""

import json
from pathlib import Path
from unittest.mock import patch

import pytest

from actors.robots.nao.robot import Nao
from benchmarks import env_steps
from benchmarks.report import run


def test_the_command_writes_rates_and_a_breakdown(tmp_path: Path) -> None:
    file = tmp_path / "speed.json"
    words = ["--envs", "2", "--steps", "6", "--turns", "2", "--json", str(file)]
    run("env_steps", env_steps.Options, env_steps.measure, words)
    content = json.loads(file.read_text())
    assert content["envs"] == 2
    for kind, row in zip(("robot_sync", "robot_wait", "ale"), content["rows"], strict=True):
        assert row["least"] <= content[kind] == row["per second"] <= row["most"]
        assert row["per step"] >= 1
    assert content["rows"][0]["agent steps"] == content["rows"][2]["agent steps"] == 12
    assert set(content["breakdown_us"]) == {"physics", "emulator", "render", "detection", "rest"}
    assert all(micros > 0 for micros in content["breakdown_us"].values())


def test_parts_add_up_to_the_whole_and_stopwatches_go_again() -> None:
    methods = [getattr(owner, name) for parts in env_steps._PARTS.values() for owner, name in parts]
    player = env_steps.Player("robot_sync", env_steps.Options())
    now = 0.0

    def clock() -> float:
        nonlocal now
        now += 1e-6
        return now

    with patch("benchmarks.env_steps.time.perf_counter", clock):
        parts = env_steps.break_down(player, 10)
    player.close()
    # Every call of a part takes one tick of this clock, and there is a tick after each.
    assert parts["detection"] == pytest.approx(1.0)
    assert parts["render"] == pytest.approx(2.0)
    assert parts["emulator"] == pytest.approx(5.0)
    assert parts["physics"] == pytest.approx(5.0)
    assert sum(parts.values()) == pytest.approx(2 * (1 + 2 + 5 + 5) + 0.1)
    assert methods == [
        getattr(owner, name) for parts in env_steps._PARTS.values() for owner, name in parts
    ]
    assert not hasattr(Nao.step_frame, "__wrapped__")

"""The units of systemd: correct, and of one mind with the exit codes and the flags."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from actors.actor import FAREWELL
from actors.options import ActorOptions
from common.command_line.parser import parse
from common.command_line.run_options import parse_run
from common.exit_codes import EXIT_CODES
from learner.options import LearnerOptions
from replay.__main__ import ReplayOptions
from tests.paths import ROOT

UNITS = sorted((ROOT / "deploy/systemd").glob("*.service"))
IN_VAIN = {code.number for code in EXIT_CODES if not code.again}


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_a_unit_is_not_started_again_where_that_is_in_vain(unit: Path) -> None:
    text = unit.read_text()
    told = re.search(r"(?m)^RestartPreventExitStatus=(.+)$", text)
    assert told is not None
    assert {int(code) for code in told[1].split()} == IN_VAIN
    assert "Restart=on-failure" in text
    assert "Type=notify" in text


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_a_start_has_time_to_read_a_ring_or_to_find_a_hub(unit: Path) -> None:
    told = re.search(r"(?m)^TimeoutStartSec=(.+)$", unit.read_text())
    assert told is not None
    assert told[1] == ("infinity" if "actor" in unit.name else "10min")


def flags_of(unit: Path, folder: Path, arguments: str) -> list[str]:
    """What the unit's command gives to Python in ``folder``, where ARGS is ``arguments``."""
    found = re.search(r"(?m)^ExecStart=(.+)$", unit.read_text())
    assert found is not None
    command = found[1].replace("$$", "$").replace("%l-%i", "a")
    told = subprocess.run(
        command.replace("/opt/ale-robot/.venv/bin/python", "echo"),
        shell=True,
        cwd=folder,
        env={"RUN": "r", "ARGS": arguments},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert told[:2] == ["-P", "-m"]
    assert told[2].rstrip("s") in unit.stem
    return told[3:]


def test_the_first_start_begins_a_run_and_others_go_on_with_it(tmp_path: Path) -> None:
    learner, replay = (
        ROOT / f"deploy/systemd/ale-robot-{x}.service" for x in ("learner", "replay")
    )
    for unit, kind in ((learner, LearnerOptions), (replay, ReplayOptions)):
        first = flags_of(unit, tmp_path, "--game breakout")
        options = parse_run(kind, "program", first, lambda _: None)
        assert isinstance(options, LearnerOptions | ReplayOptions)
        assert (options.run, options.resume, options.config.game) == ("r", False, "breakout")
        assert options.http is not None
    (tmp_path / "runs/r").mkdir(parents=True)
    (tmp_path / "runs/r/config.json").touch()
    for unit in (learner, replay):
        assert flags_of(unit, tmp_path, "--game breakout")[-1] == "--resume"


def test_an_actor_waits_for_its_hub(tmp_path: Path) -> None:
    unit = ROOT / "deploy/systemd/ale-robot-actor@.service"
    options = parse(ActorOptions, "actors", flags_of(unit, tmp_path, "--evaluator"))
    assert (options.name, options.evaluator, options.patience) == ("a", True, float("inf"))


@pytest.mark.parametrize(
    ("file", "limit"),
    [
        ("systemd/ale-robot-actor@.service", r"(?m)^TimeoutStopSec=(\d+)$"),
        ("compose/compose.yaml", r"(?s)\n  actor: &actor\n.*stop_grace_period: (\d+)s.*evaluator:"),
    ],
)
def test_an_actor_may_wait_for_its_last_acknowledgements(file: str, limit: str) -> None:
    told = re.search(limit, (ROOT / "deploy" / file).read_text())
    assert told is not None
    assert int(told[1]) >= 2 * FAREWELL


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
def test_systemd_finds_no_fault(tmp_path: Path) -> None:
    for unit in UNITS:
        text = unit.read_text().replace("/opt/ale-robot/.venv/bin/python", sys.executable)
        (tmp_path / unit.name).write_text(text)
    done = subprocess.run(
        ["systemd-analyze", "verify", *(str(tmp_path / unit.name) for unit in UNITS)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")

"""How a run does, asked of its processes in one process: table, JSON and exit code."""

import errno
import io
import json
import math
import os
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn
from unittest.mock import Mock

import numpy as np
import pytest
from rich.console import Console

from common.checked import MAX_COUNT
from common.endpoint import DEFAULT_ENDPOINT
from common.errors import InputError, Unreachable
from common.exit_codes import DONE, FAILED, UNREACHABLE
from common.process.log_lines import kept_log
from common.protocol.actor_stats import ActorStats
from common.protocol.run_keys import RunKeys
from common.protocol.run_status import HealthCheck
from common.run.folder import RunFolder
from common.run.newest_learner import NewestLearner
from common.transport.interface import Envelope, Transport
from common.version import VERSION
from learner.folder_report import FolderReport
from learner.status import Report, ask, main
from learner.telemetry.health_checks import LONGEST_SILENCE
from learner.telemetry.sinks.status import StatusSink
from learner.telemetry.snapshot import ActorView
from replay.replay_buffer import ReplayBuffer
from replay.server import ReplayServer
from tests.clock import Clock
from tests.in_process_transport import InProcessHub
from tests.learner.telemetry.snapshots import snapshot
from tests.replay.replay_reference import GOES_ON, Actor, make_config

RUN = "pong-1"
KEYS = RunKeys(RUN)
NOW = snapshot(
    {
        "run/phase": "training",
        "run/epoch": 2,
        "run/agent_steps": 8_000,
        "run/sync": True,
        "learning/updates_per_second": 12.5,
        "stream/weights_version": 1_000,
        "stream/staleness_p50": 4.0,
        "hands/press_p99": math.inf,
        "play/train_reward": -20.5,
        "run/join": "x" * 500,
    },
    actors=(
        ActorView(
            stats=ActorStats("a-1", "actor", steps_per_second=71.25, weights_version=990),
            alive=True,
        ),
        ActorView(stats=ActorStats("e-1", "evaluator"), alive=False, silent_for=7.0),
        ActorView(stats=ActorStats("a-2", "actor", leaving=True), alive=False, silent_for=9.0),
    ),
    checks=(
        HealthCheck(name="valid frames", value=1.0, passed=True, bound="≥ 0.99", why="no screen"),
        HealthCheck(name="press", value=90.0, passed=False, bound="≤ 66", why="slow", stops=False),
    ),
)
RED = HealthCheck(name="sight", value=math.nan, passed=False, bound="≥ 0.99", why="it is blind")


@pytest.fixture
def client(tmp_path: Path) -> Iterator[Transport]:
    """A client of a hub whose replay has 8 steps."""
    config = make_config()
    hub = InProcessHub()
    with hub.connect() as served, hub.connect() as client:
        buffer = ReplayBuffer(config, tmp_path / "replay")
        actor = Actor("a-1", 4)
        buffer.insert(actor.live([GOES_ON] * 8, np.random.default_rng(0)))
        with ReplayServer(served, buffer, config, RUN):
            yield client
        buffer.close()


def test_a_healthy_run(client: Transport) -> None:
    sink = StatusSink(client, KEYS)
    sink.write(NOW)
    report = ask(client, KEYS, "tcp/here")
    assert report.reasons == []
    text = shown(report)
    for words in (
        "run pong-1 at tcp/here: pong (ale)\n",
        "preset fast, training, epoch 2, 8,000 steps\n",
        "8 steps ",
        "12.5 updates/s",
        "71.2 steps/s",
        "10 updates",
        "evaluator, lost",
        "actor, left",
        "7 s ago",
        "warning: press is 90.00, not ≤ 66: slow",
        "healthy",
    ):
        assert words in text
    told = json.loads(report.as_json())
    assert (told["state"], told["healthy"], told["replay"]["stored"]) == ("at work", True, 8)
    assert [actor["lag"] for actor in told["learner"]["actors"]] == [10, 0, 1_000]
    assert told["learner"]["values"]["hands/press_p99"] is None
    assert told["version"] == told["learner"]["version"] == told["replay"]["version"]


def test_the_row_of_a_throttled_actor_fits_80_columns(client: Transport) -> None:
    stats = ActorStats("a-1", "actor", steps_per_second=22.5, weights_version=988)
    actors = tuple(
        ActorView(stats=replace(stats, name=name, throttled_share=share), alive=True)
        for name, share in (("vm-00000001", 0.004), ("vm-00000002", 0.606))
    )
    StatusSink(client, KEYS).write(replace(NOW, actors=actors))
    text = shown(ask(client, KEYS, "tcp/here"), 80)
    assert re.search(r"vm-00000001 +actor +\d", text)
    assert re.search(r"vm-00000002 +actor, throttled 61% +\d", text)


def test_versions_are_told_where_they_differ(client: Transport) -> None:
    StatusSink(client, KEYS).write(NOW)
    report = ask(client, KEYS, "tcp/here")
    assert not re.search(r"\bversion\b", shown(report))
    assert report.learner is not None
    odd = report.learner.actors[0]._replace(version="0.0.1")
    mixed = replace(report, learner=replace(report.learner, actors=(odd,)))
    text = shown(mixed, 80)
    assert re.search(r" heard +version *\n", text)
    assert re.search(rf"\n learner .* {re.escape(VERSION)} *\n", text)
    assert re.search(r"\n a-1 .* 0\.0\.1 *\n", text)


def shown(report: Report, width: int = 120) -> str:
    out = io.StringIO()
    report.show(Console(file=out, width=width))
    return out.getvalue()


@pytest.mark.parametrize(
    ("env", "game", "told"), [("robot", "pong", "pong (robot)"), ("lamps", "lamps", "lamps")]
)
def test_it_tells_what_is_played(client: Transport, env: str, game: str, told: str) -> None:
    StatusSink(client, KEYS).write(snapshot({"run/env": env, "run/game": game}))
    assert f": {told}\npreset fast, " in shown(ask(client, KEYS, "tcp/here"))


def test_no_process_can_steer_the_terminal_of_who_asks(client: Transport) -> None:
    wicked = "\x1b]0;mine\x07\x9b2J\n"
    actor = ActorView(stats=ActorStats("a-1", "actor", version=wicked), alive=True)
    checks = [
        HealthCheck(name=wicked, value=1.0, passed=False, bound=wicked, why=wicked, stops=stops)
        for stops in (False, True)
    ]
    told = snapshot(
        {"run/game": wicked, "run/phase": wicked}, actors=(actor,), checks=tuple(checks)
    )
    StatusSink(client, KEYS).write(told)
    report = ask(client, KEYS, wicked)
    wicked_too = replace(report, replay=replace(report.replay, version=wicked))
    lines = shown(wicked_too).split("\n")
    assert all(line.isprintable() for line in lines)
    assert sum("mine" in line for line in lines) == 7


def test_what_is_longer_than_a_line_breaks_without_a_blank_at_its_end(client: Transport) -> None:
    why = "much-too-slow-for-a-robot " * 6
    checks = tuple(check._replace(why=why) for check in (*NOW.checks, RED))
    StatusSink(client, KEYS).write(replace(NOW, checks=checks))
    lines = shown(ask(client, KEYS, "tcp/127.0.0.1:7447"), 80).splitlines()
    assert lines[0] == "run pong-1 at tcp/127.0.0.1:7447: pong (ale)"
    assert lines[1] == "preset fast, training, epoch 2, 8,000 steps"
    sentences = [line for line in lines if not re.search("  |─", line)]  # and no part of the table
    assert sum("too-slow" in line for line in sentences) == 6  # of a warning and a reason
    assert not any(line.endswith((" ", "-")) for line in sentences)


def test_a_terminal_without_columns_costs_no_more_than_the_text(client: Transport) -> None:
    StatusSink(client, KEYS).write(NOW)
    assert not shown(ask(client, KEYS, ""), 0).strip()


def test_processes_that_have_not_joined_yet_have_a_row(client: Transport) -> None:
    sink = StatusSink(client, KEYS)
    rows = []
    for starting in (2, 0):
        sink.write(snapshot({"stream/actors_starting": starting}))
        rows.append(re.findall(r"(\d local) +starting ", shown(ask(client, KEYS, ""))))
    assert rows == [["2 local"], []]


def test_a_run_without_an_actor_is_told_how_to_start_one(client: Transport) -> None:
    sink = StatusSink(client, KEYS)
    advice = "nobody plays: start an actor by `ale-robot join --connect tcp/h:1`"
    evaluator = ActorView(stats=ActorStats("e-1", "evaluator"), alive=True)
    for present, told in (
        (snapshot({}, actors=(evaluator,)), True),
        (snapshot({}, actors=(NOW.present[1],)), True),
        (snapshot({"stream/actors_starting": 1}), False),
        (snapshot({"run/phase": "finishing"}, actors=(evaluator,)), False),
        (NOW, False),
    ):
        sink.write(present)
        assert (advice in shown(ask(client, KEYS, "tcp/h:1"))) is told


@pytest.fixture
def ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunFolder:
    """A run of this machine at which nobody works, in the runs of the working directory."""
    monkeypatch.chdir(tmp_path)
    folder = RunFolder(Path("runs"), "first")
    folder.path.mkdir(parents=True)
    folder.config_file.write_text("{}")
    summary = {"env": "robot", "game": "pong", "preset": "robot", "epoch": 3, "agent_steps": 51_000}
    summary |= {"wall_seconds": 95.0, "train_reward": -20.5, "best_test_reward": "\x1b[2J"}
    folder.summary.write_text(json.dumps({**summary, "epsilon": [1]}))
    os.utime(folder.summary, (0, time.mktime((2026, 11, 29, 7, 57, 0, 0, 0, -1))))
    return folder


GO_ON = "nobody works at run first: go on with `ale-robot train --run first --resume`"


@pytest.mark.parametrize("named", ["first", "runs/first", "runs/first/"])
def test_a_run_that_has_ended_tells_how_far_it_came(
    ended: RunFolder, named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([named]) == UNREACHABLE
    assert capsys.readouterr().out.splitlines() == [
        "run first: pong (robot), preset robot",
        "ended on 2026-11-29 07:57 in epoch 3, after 51,000 steps in 01:35",
        "score: training −20.50, test –, best test –, random –",
        GO_ON,
    ]
    assert main([named, "--json"]) == UNREACHABLE
    told = json.loads(capsys.readouterr().out)
    assert (told["run"], told["healthy"], told["reasons"]) == ("first", False, [GO_ON])
    assert told["state"] == "ended"
    assert (told["ended"], told["summary"]["agent_steps"]) == ("2026-11-29 07:57", 51_000)


def test_a_run_that_stopped_itself_tells_why(
    ended: RunFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    log = ended.logs / "learner.jsonl"
    with pytest.raises(InputError), kept_log(log, "learner"):
        raise InputError("the robot\nis blind: heal it.")
    main(["first"])
    reason = GO_ON.replace("go on", "once that is mended, go on")
    assert capsys.readouterr().out.splitlines()[-2:] == ["the robot is blind: heal it.", reason]
    main(["first", "--json"])
    told = json.loads(capsys.readouterr().out)
    assert (told["error"], told["reasons"]) == ("the robot\nis blind: heal it.", [reason])
    with kept_log(log, "learner") as keep:
        keep("actor-1 joined")  # it was resumed, and ended in peace
    main(["first"])
    assert capsys.readouterr().out.splitlines()[-2:] == [
        "score: training −20.50, test –, best test –, random –",
        GO_ON,
    ]


@pytest.mark.parametrize(
    "content",
    ["", "{", "[1]", "7", '{"epoch": "three", "wall_seconds": true}', '{"env": "{x}", "game": "g"}']
    + [
        f'{{"epoch": {number}, "wall_seconds": {number}, "train_reward": {number}}}'
        for number in ("NaN", "Infinity", "1" + 400 * "0", "true")
    ],
)
def test_what_is_left_of_a_damaged_run_is_told(
    ended: RunFolder, content: str, capsys: pytest.CaptureFixture[str]
) -> None:
    ended.summary.write_text(content)
    ended.logs.mkdir()
    (ended.logs / "learner.jsonl").write_text('{"level": "error"}\n')
    assert main(["first"]) == UNREACHABLE
    *told, last = capsys.readouterr().out.splitlines()
    assert last == GO_ON
    is_table = len(content) > 3
    if is_table:
        assert told[1].endswith("in the warm-up, after – steps in –")
    assert main(["first", "--json"]) == UNREACHABLE
    found = json.loads(capsys.readouterr().out)
    assert (found["summary"] is None) != is_table
    assert found["error"] is None


def test_a_run_in_another_folder_goes_on_from_there(ended: RunFolder, tmp_path: Path) -> None:
    there = FolderReport.of(RunFolder(tmp_path / "elsewhere", "first"))
    assert (
        there.resume_command == f"ale-robot train --runs {tmp_path}/elsewhere --run first --resume"
    )


ADDRESS = "tcp/127.0.0.1:7555"


def newest_of(folder: RunFolder, certificates: str | None = "/keys") -> NewestLearner:
    """What a learner of this working directory writes of itself."""
    real = str(folder.path.resolve())
    return NewestLearner(real, ADDRESS, certificates, os.getcwd(), "make train", False)


@pytest.mark.parametrize(
    ("certificates", "more", "place"),
    [
        ("/keys", ["first"], (ADDRESS, Path("/keys"))),
        ("/keys", ["link"], (ADDRESS, Path("/keys"))),
        ("/keys", ["first", "--certificates", "mine"], (ADDRESS, Path("mine"))),
        (None, ["runs/first/"], (ADDRESS, None)),
        (None, [], (ADDRESS, None)),  # the only one that is at work here
        ("former", ["first"], (DEFAULT_ENDPOINT, None)),
        # It may be anywhere.
        ("/keys", ["first", "--connect", "tcp/h:1"], ("tcp/h:1", None)),
        ("/keys", ["runs/first", "--connect", "tcp/h:1"], ("tcp/h:1", None)),
    ],
)
def test_a_run_that_is_at_work_is_asked_by_its_name_at_its_address(
    ended: RunFolder,
    client: Transport,
    monkeypatch: pytest.MonkeyPatch,
    certificates: str | None,
    more: list[str],
    place: tuple[str, Path | None],
) -> None:
    asked: list[object] = []

    def connect(endpoint: str, *_: object, certificates: Path | None, **__: object) -> Any:
        asked.append((endpoint, certificates))
        return nullcontext(client)

    def find_run(_: Transport, name: str, *__: object) -> tuple[RunKeys, None]:
        asked.append(name)
        return KEYS, None

    monkeypatch.setattr("learner.status.connect", connect)
    monkeypatch.setattr("learner.status.find_run", find_run)
    if certificates != "former":
        newest_of(ended, certificates).write(ended)
    Path("link").symlink_to("runs/first")
    ended.config_file.unlink()
    ended.claim("replay", make_config(), resume=False)
    StatusSink(client, KEYS).write(snapshot({}))
    assert main(more) == DONE
    assert asked == [place, "first"]


def test_one_of_several_runs_at_work_has_to_be_named(ended: RunFolder) -> None:
    claimed = []
    for name in ("first", "second"):
        run = RunFolder(ended.path.parent, name)
        run.config_file.unlink(missing_ok=True)
        run.claim("replay", make_config(), resume=False)
        claimed.append(run)
    with pytest.raises(InputError, match=r"^several runs are at work here: name one of first, sec"):
        main([])


def test_a_run_whose_locks_cannot_be_opened_is_none_of_ours(
    ended: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> NoReturn:
        raise PermissionError(errno.EACCES, "Permission denied", str(ended.path))

    monkeypatch.setattr(RunFolder, "is_at_work", refused)
    monkeypatch.setattr("learner.status.connect", Mock(side_effect=Unreachable("nobody.")))
    with pytest.raises(Unreachable, match=r"^nobody\. Runs here: first"):
        main([])


def test_a_run_that_starts_is_not_told_to_be_missing(
    ended: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def connect(*_: object, **__: object) -> NoReturn:
        raise Unreachable("nobody answers: start a learner there.")

    monkeypatch.setattr("learner.status.connect", connect)
    with pytest.raises(
        Unreachable, match=r"start a learner there\. Runs here: first; `status RUN`"
    ):
        main([])
    with pytest.raises(Unreachable, match=r"^nobody answers: start a learner there\.$"):
        main(["--connect", "tcp/h:1"])
    ended.config_file.unlink()
    ended.claim("replay", make_config(), resume=False)
    words = r"^somebody works at run first, but nobody answers for it at tcp/127.0.0.1:7447: it may"
    with pytest.raises(Unreachable, match=words):
        main(["first"])


def test_a_run_goes_on_by_the_command_of_its_newest_learner(
    ended: RunFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    def told(named: str = "first") -> str:
        main([named])
        return capsys.readouterr().out.splitlines()[-1].rpartition("go on with ")[2]

    newest_of(ended).write(ended)
    assert told() == "`make train`"
    replace(newest_of(ended), resume_command="x\x1b[2J" + "y" * 3_000).write(ended)
    assert told() == "`x [2J" + "y" * 3_000 + "`"
    replace(newest_of(ended), directory="/else where").write(ended)
    assert told() == "`cd '/else where' && make train`"
    shutil.copytree("runs/first", "runs/second")  # going on with that is not going on with this
    assert told("second") == "`ale-robot train --run second --resume`"
    replace(newest_of(ended), ended="done").write(ended)
    main(["first"])
    assert capsys.readouterr().out.splitlines()[-1] == (
        "run first has all its steps: train on with `make train`"
    )
    ended.newest_learner.write_text('{"endpoint": 5}')  # damaged
    assert f"go on with {told()}" in GO_ON


def test_a_folder_that_cannot_be_a_runs_is_passed_over(
    ended: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = Path("runs/my run")
    other.mkdir()
    (other / "config.json").touch()
    with pytest.raises(InputError, match=r"^frist is not a run: did you mean first\?$"):
        main(["frist"])


def test_what_is_no_run_is_told() -> None:
    with pytest.raises(InputError, match=r"^r is not a run: name one, or its folder; .*runs has"):
        main(["r", "--json"])
    with pytest.raises(InputError, match=r"^--run s names a run beside r: omit one of them\.$"):
        main(["r", "--run", "s"])


def test_a_run_that_ended_in_its_warm_up(
    ended: RunFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    ended.summary.write_text('{"env": "ale", "game": "pong", "epoch": 0, "agent_steps": 300}')
    main(["first"])
    assert " in the warm-up, after 300 steps in –\n" in capsys.readouterr().out


def test_what_liars_count_hides_nothing(client: Transport) -> None:
    StatusSink(client, KEYS).write(snapshot({"actors/steps": 3 * MAX_COUNT}))  # a sum of three
    report = ask(client, KEYS, "")
    assert report.learner is not None
    assert report.learner.values["actors/steps"] == MAX_COUNT


@pytest.mark.parametrize("key", ["run/epoch", "learning/updates_per_second"])
def test_a_text_where_a_number_belongs_is_another_versions(client: Transport, key: str) -> None:
    StatusSink(client, KEYS).write(snapshot({key: "many"}))
    with pytest.raises(Unreachable, match=f"{key} should be a number.*: use the same version"):
        ask(client, KEYS, "")


def test_a_red_check_and_a_loop_that_hangs_are_told(client: Transport) -> None:
    clock = Clock(100.0)
    sink = StatusSink(client, KEYS, clock)
    sink.write(snapshot({}, checks=(RED,)))
    assert ask(client, KEYS, "").reasons == ["health check 'sight' is red: it is blind"]
    sink.write(snapshot({}))
    assert ask(client, KEYS, "").reasons == []
    clock.now += LONGEST_SILENCE
    (reason,) = ask(client, KEYS, "").reasons
    assert reason == "the training loop has not looked around for 60 s: see its log"


def test_the_exit_code_tells_whether_all_is_well(
    client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("learner.status.connect", lambda *_, **__: nullcontext(client))
    monkeypatch.setattr("learner.status.find_run", lambda *_: (KEYS, None))
    assert main([]) == FAILED, "no learner answers"
    sink = StatusSink(client, KEYS)
    codes = []
    for checks in ((), (RED,)):
        sink.write(snapshot({}, checks=checks))
        codes.append(main(["--json"]))
    assert codes == [DONE, FAILED]


@pytest.mark.parametrize(("patience", "seconds"), [("60", 60), ("0", 2), ("inf", 3_600)])
def test_processes_of_a_busy_machine_are_given_as_long_as_the_hub(
    client: Transport, monkeypatch: pytest.MonkeyPatch, patience: str, seconds: float
) -> None:
    gather, deadlines = client.gather, []

    def gathered(key: str, deadline: float, payload: bytes = b"") -> list[Envelope]:
        deadlines.append(deadline)
        return gather(key, deadline, payload)

    monkeypatch.setattr(client, "gather", gathered)
    monkeypatch.setattr("learner.status.connect", lambda *_, **__: nullcontext(client))
    monkeypatch.setattr("learner.status.find_run", lambda *_: (KEYS, None))
    main([f"--patience={patience}"])
    assert deadlines == [seconds, seconds]


def test_a_run_without_a_learner(client: Transport) -> None:
    report = ask(client, KEYS, "")
    assert report.reasons == [
        "no learner answers: unless it is just starting, start it again with --resume"
    ]
    assert "does not answer" in shown(report)
    StatusSink(client, KEYS)  # one that has just begun
    assert ask(client, KEYS, "").learner is None


def test_nobody_answers() -> None:
    with InProcessHub().connect() as client, pytest.raises(Unreachable, match="does not answer"):
        ask(client, KEYS, "")

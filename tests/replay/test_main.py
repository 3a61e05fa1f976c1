"""`python -m replay` as a real process, killed and restarted."""

import re
import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest

from benchmarks.child import free_endpoint
from common.command_line.run_options import parse_run
from common.run.join import find_run
from common.settings.presets import PRESETS
from common.transport.chosen import connect
from learner.options import LearnerOptions
from replay import __main__ as replay_main
from replay.__main__ import ReplayOptions
from replay.__main__ import _line as replay_line
from replay.chunk_statistics import ReplayProgress
from replay.client import RemoteReplay
from tests.patience import PATIENCE, wait_until
from tests.replay.replay_reference import GOES_ON, RUN, TERMINATES, Actor
from tests.replay.replay_requests import insert

FLAGS = [
    *("--play.no-minimal-actions", "--replay.capacity", "400", "--replay.learning-starts", "50"),
    *("--stream.chunk-steps", "16", "--learning.batch-size", "32"),
]
_FAST = PRESETS["fast"]
CONFIG = replace(_FAST, learning=replace(_FAST.learning, batch_size=32))


class Process:
    """A replay process and what it prints."""

    def __init__(self, folder: Path, endpoint: str, *flags: str) -> None:
        command = [sys.executable, "-m", "replay", "--run", RUN, "--runs", str(folder)]
        command += ["--preset", "fast", "--listen", endpoint, *FLAGS, *flags]
        self.command = command
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self.lines: list[str] = []
        self._serving = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line)
            if " stored, " in line:
                self._serving.set()

    def wait_until_it_serves(self) -> None:
        assert self._serving.wait(PATIENCE), self.lines

    def ended(self) -> int:
        status = self.process.wait(PATIENCE)
        self._reader.join(PATIENCE)
        return status


@pytest.fixture
def started(tmp_path: Path, forks: None) -> Iterator[list[Process]]:
    processes: list[Process] = []
    yield processes
    for each in processes:
        each.process.kill()
        each.process.wait(PATIENCE)


def test_nothing_acknowledged_is_lost_by_kill_9(tmp_path: Path, started: list[Process]) -> None:
    endpoint = free_endpoint()
    started.append(Process(tmp_path, endpoint))
    started[0].wait_until_it_serves()
    transport = connect(endpoint, PATIENCE)
    actor, rng = Actor("a", 4), np.random.default_rng(0)
    chunks = [actor.live([GOES_ON] * 15 + [TERMINATES], rng) for _ in range(30)]  # the ring turns
    keys, _ = find_run(transport, RUN, PATIENCE)
    chunks = [replace(chunk, run_id=keys.run_id) for chunk in chunks]
    for chunk in chunks[:-1]:
        assert insert(transport, chunk).status == "stored"
    remote = RemoteReplay(transport, keys, CONFIG)
    before = remote.progress(0)
    assert before.stored == 25 * 16
    started[0].process.send_signal(signal.SIGKILL)
    assert started[0].ended() == -signal.SIGKILL

    found: list[object] = []
    learner = threading.Thread(target=lambda: found.append(remote.progress(0)))
    learner.start()  # a learner that asks while there is nobody
    started.append(Process(tmp_path, endpoint, "--resume"))
    started[1].wait_until_it_serves()
    learner.join(PATIENCE)
    after = remote.progress(0)
    assert found[0] == replace(
        after,
        resident_bytes=found[0].resident_bytes,  # type: ignore[attr-defined]
        private_bytes=found[0].private_bytes,  # type: ignore[attr-defined]
    )
    assert after.statistics == before.statistics
    assert (after.agent_steps, after.stored, after.samplable) == (29 * 16, 400, 400)
    assert insert(transport, chunks[-2]).status == "duplicate"
    assert insert(transport, chunks[0]).status == "duplicate"  # evicted, but not forgotten
    assert insert(transport, chunks[-1]).status == "stored"
    batch = remote.sample(0, 20.0)
    assert batch is not None
    frames = np.concatenate([chunk.frames for chunk in chunks])
    for at, id_ in enumerate(batch.ids):
        assert (batch.s_tm1[at, -1] == frames[id_]).all()
    transport.close()
    started[1].process.send_signal(signal.SIGINT)
    assert started[1].ended() == 0
    told, where, go_on = started[1].lines[-3:]
    assert re.search(r"480 steps, 400 stored, .* 30 accepted, 2 duplicate", told)
    assert where.endswith(f"The replay is in {tmp_path / RUN / 'replay'}; go on with:\n")
    assert shlex.split(go_on) == ["python", *started[0].command[1:], "--resume"]


def test_sizes_are_told_in_decimal_units() -> None:
    told = ReplayProgress(*(0,) * 6, False, 2_000_000_000, 30_000_000, 4_500_000_000, ())
    words = "; 30 MB private, 2,000 MB resident, 4.50 GB of file."
    assert replay_line(told).endswith(words)


def test_what_cannot_be_is_said_in_one_line(tmp_path: Path, started: list[Process]) -> None:
    endpoint = free_endpoint()
    started.append(Process(tmp_path, endpoint))
    started[0].wait_until_it_serves()
    started[0].process.send_signal(signal.SIGTERM)
    assert started[0].ended() == 0
    for flags, complaint in (
        ([], "already holds a run"),
        (["--resume", "--learning.n-step", "2"], "n_step 5 → 2"),
        (["--resume", "--listen", "somewhere"], "not an address"),
        (["--resume", "--connect", "tcp/127.0.0.1:1"], "give --listen or --connect"),
    ):
        refused = Process(tmp_path, endpoint, *flags)
        started.append(refused)
        assert refused.ended() == 2
        (line,) = refused.lines
        assert complaint in line


def test_a_hub_that_cannot_be_asked_for_its_runs_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    transport = MagicMock()
    transport.__enter__.return_value = transport
    transport.gather.side_effect = RuntimeError("closed")
    monkeypatch.setattr(replay_main, "connect", lambda *_, **__: transport)
    options = parse_run(
        ReplayOptions, "replay", ["--run", RUN, "--connect", "tcp/127.0.0.1:1"], lambda _: None
    )
    with pytest.raises(RuntimeError):
        replay_main._open(options, threading.Event())
    assert transport.__exit__.called


def test_with_the_same_initial_network_its_settings_are_those_of_the_learner() -> None:
    """`ale_pong` has other layers than the preset's."""
    flags = ["--run", RUN, "--preset", "fast", "--initial", "ale_pong"]
    learner = parse_run(LearnerOptions, "learner", flags, lambda _: None)
    replay = parse_run(ReplayOptions, "replay", flags, lambda _: None)
    assert replay.config == learner.config
    assert replay.config.learning.layer_norm != _FAST.learning.layer_norm


def test_its_command_to_go_on_leaves_the_initial_network_out(
    tmp_path: Path, started: list[Process]
) -> None:
    """The run has its settings by then, and the file may be gone."""
    started.append(Process(tmp_path, free_endpoint(), "--initial=ale_pong"))
    started[0].wait_until_it_serves()
    started[0].process.send_signal(signal.SIGTERM)
    assert started[0].ended() == 0
    *before, initial = started[0].command[1:]
    assert initial == "--initial=ale_pong"
    assert shlex.split(started[0].lines[-1]) == ["python", *before, "--resume"]


def test_that_nobody_reads_what_it_says_is_no_reason_to_end(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    command = [sys.executable, "-m", "replay", "--run", RUN, "--runs", str(tmp_path)]
    command += ["--preset", "fast", "--listen", endpoint, *FLAGS]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        assert process.stdout is not None
        process.stdout.close()
        with connect(endpoint, PATIENCE) as transport:
            keys, _ = find_run(transport, RUN, PATIENCE)
            inserts = transport.requester(keys.insert("a"), PATIENCE)
            wait_until(lambda: inserts.has_server, "the replay serves inserts")
            actor = Actor("a", 4, run_id=keys.run_id)
            chunk = actor.live([GOES_ON] * 15 + [TERMINATES], np.random.default_rng(0))
            assert insert(transport, chunk).status == "stored"
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=PATIENCE)
        assert (process.returncode, errors) == (0, b"")
    finally:
        process.kill()
        process.wait()

"""The start of the process that trains."""

import json
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock, Mock

import pytest
import torch

from common.atomic_file import write_atomically
from common.command_line.run_options import parse_run
from common.errors import InputError
from common.run.folder import RunFolder
from common.run.network_file import encode_network_file
from common.run.newest_learner import NewestLearner
from common.settings.config import RunConfig
from learner import process
from learner.demonstrations import start
from learner.first_network import first_network
from learner.options import LearnerOptions, stored_config


class Killed(BaseException):
    """As by kill -9: nobody cleans up."""


def test_a_start_that_is_killed_leaves_its_network_or_nothing_to_resume(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once there is a configuration, `--resume` alone goes on with what the start was given."""
    here = ("--runs", str(tmp_path), "--run", "r", "--env", "ale", "--learning.network=nips")

    def options(*more: str) -> LearnerOptions:
        return parse_run(LearnerOptions, "learner", [*here, *more], stored_config)

    folder = RunFolder(tmp_path, "r")
    given, network = tmp_path / "given.safetensors", first_network(options("--seed=7"), folder)
    given.write_bytes(encode_network_file(network, options().config))

    def killed(before: Any, after: Any) -> None:
        def last(path: Path, *content: Any) -> None:
            if path == before:
                raise Killed
            write_atomically(path, *content)
            if path == after:
                raise Killed

        with monkeypatch.context() as patched:
            for unneeded in ("build_algorithm", "choose_device", "on_signals"):
                patched.setattr(process, unneeded, Mock())
            for module in ("learner.process", "common.run.folder"):
                patched.setattr(f"{module}.write_atomically", last)
            with pytest.raises(Killed):
                process.train(options("--initial", str(given), "--threads=1"), again=False)

    for moment in ((folder.initial, None), (None, folder.initial), (folder.config_file, None)):
        killed(*moment)
        with pytest.raises(InputError, match=r"there is no run in .* to resume"):
            options("--resume").check_here()
    killed(None, folder.config_file)
    options("--resume").check_here()
    found = first_network(options("--resume"), folder)
    assert torch.equal(found.hidden.weight, network.hidden.weight)


@pytest.mark.parametrize("stopped", [False, True])
def test_a_learner_that_is_stopped_while_it_sends_demonstrations_publishes_no_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stopped: bool
) -> None:
    given = ["--runs", str(tmp_path), "--run", "r", "--env", "ale", "--threads=1"]
    options = parse_run(LearnerOptions, "learner", given, stored_config)
    sent = None if stopped else Mock(encode=lambda: b"complete")
    recorded = Mock(begun=Mock(encode=lambda: b"begun"))
    learner, replay = MagicMock(failed=None, phases=Mock(done=False)), Mock(run_id="id")
    learner.evaluation.snapshots.keep = stopped
    replay.progress.return_value.file_bytes = 0
    folder = RunFolder(tmp_path, "r")

    def build(*given: Any, **more: Any) -> Any:
        folder.gates.touch()
        return learner

    for name, found in {
        "begin_with": lambda *given, **how: recorded,
        "open_pages": lambda *given: nullcontext(((), None)),
        "open_replay": lambda *given: nullcontext((Mock(), replay, "tcp/127.0.0.1:1")),
        "build_learner": build,
        **dict.fromkeys(("build_algorithm", "on_signals", "end_with_any_thread"), MagicMock()),
    }.items():
        monkeypatch.setattr(process, name, found)
    monkeypatch.setattr(start, "insert", lambda *given: sent)
    assert process.train(options, again=False) == 0
    assert learner.start.called == learner.run.called != stopped
    assert learner.telemetry.__exit__.called
    newest = NewestLearner.of(folder)
    assert newest is not None
    assert (newest.endpoint, newest.keeps_snapshots) == ("tcp/127.0.0.1:1", stopped)
    assert newest.resume_command.endswith("--run r --resume")
    assert folder.demonstrations.read_bytes() == (b"begun" if stopped else b"complete")


def test_a_learner_says_where_it_is_found_and_how_its_run_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["learner", "--run", "r", "--steps", "90000"])
    monkeypatch.chdir(tmp_path)
    folder = RunFolder(Path("runs"), "r")
    folder.path.mkdir(parents=True)
    options = LearnerOptions(RunConfig(), certificates=Path("keys"))
    for done, steps in ((False, " --steps 90000"), (True, "")):
        learner: Any = Mock(phases=Mock(done=done))
        learner.evaluation.snapshots.keep = True
        process._write_newest(options, folder, "tcp/h:1", learner)
        assert NewestLearner.of(folder) == NewestLearner(
            str(tmp_path / "runs" / "r"),
            "tcp/h:1",
            str(tmp_path / "keys"),
            str(tmp_path),
            f"python -m learner --run r{steps} --resume",
            keeps_snapshots=True,
        )


@pytest.mark.parametrize(
    ("done", "tests", "children"),
    [(False, False, (2, 1)), (True, True, (0, 1)), (True, False, (0, 0))],
)
def test_a_run_that_has_its_steps_starts_nobody_whom_it_does_not_need(
    done: bool, tests: bool, children: tuple[int, int]
) -> None:
    learner: Any = Mock(phases=Mock(done=done), has_tests_to_come=tests)
    needed = process.needed_children(LearnerOptions(RunConfig(), actors=2), learner)
    assert (needed.actors, needed.evaluators) == children


@pytest.mark.parametrize("by_itself", [True, False])
def test_the_reason_for_which_a_run_ends_is_in_its_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, by_itself: bool
) -> None:
    for unneeded in ("build_algorithm", "choose_device", "on_signals", "_first_words"):
        monkeypatch.setattr(process, unneeded, Mock())
    for name, opened in (
        ("pages", ((), None)),
        ("replay", (Mock(), Mock(), "")),
        ("display", Mock()),
    ):
        monkeypatch.setattr(process, f"open_{name}", Mock(return_value=nullcontext(opened)))
    folder = RunFolder(tmp_path, "r")
    learner = MagicMock(failed="no agent step came in 10 minutes", phases=Mock(done=False))
    learner.evaluation.snapshots.keep = False
    learner.start = folder.checkpoint.touch
    if not by_itself:
        learner.run.side_effect = InputError("actor-1 ended.")
    monkeypatch.setattr(process, "build_learner", Mock(return_value=learner))
    flags = ["--runs", str(tmp_path), "--run", "r", "--env", "ale", "--threads=1"]
    options = parse_run(LearnerOptions, "learner", flags, stored_config)
    if by_itself:
        assert process.train(options, again=False) == 3
    else:
        with pytest.raises(InputError):
            process.train(options, again=False)
    begun, kept = (folder.logs / "learner.jsonl").read_text().splitlines()
    # Or the error of a start before would be that of one that is killed.
    assert json.loads(begun)["message"] == "started"
    told = json.loads(kept)
    assert told["level"] == "error"
    stopped = "stopped: no agent step came in 10 minutes"
    assert told["message"] == (stopped if by_itself else "actor-1 ended.")

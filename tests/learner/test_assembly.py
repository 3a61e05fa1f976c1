"""A whole learner from its real parts, in one process: it starts, learns, stops and continues."""

import io
import json
import shutil
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors import safe_open

from common.errors import InputError
from common.network import build_network
from common.protocol.run_keys import RunKeys
from common.protocol.wire import decode_version
from common.run.folder import RunFolder
from common.run.origin import origin_of
from common.transport.interface import Transport
from learner.algorithm.interface import build_algorithm
from learner.assembly import build_learner
from learner.device import Device
from learner.options import LearnerOptions
from learner.telemetry.sinks.display import PlainDisplay
from learner.telemetry.sinks.sink import Sink
from learner.telemetry.snapshot import Snapshot
from learner.training import Learner
from replay.replay_buffer import ReplayBuffer
from replay.server import ReplayServer
from tests.in_process_transport import InProcessHub
from tests.patience import PATIENCE, wait_until
from tests.replay.replay_reference import GOES_ON, RUN, TERMINATES, Actor, make_config

_SMALL = make_config(capacity=2_000, learning_starts=40, batch_size=4, frame_stack=4)
CONFIG = replace(
    _SMALL,
    env="ale",
    protocol=replace(_SMALL.protocol, epoch_steps=80, test_steps=20, held_out_states=8),
    learning=replace(_SMALL.learning, train_period=8, publish_period=2),
)
PAGE = "http://127.0.0.1:8080/"
SIGNATURE = b"signature"


class Seen(Sink):
    """Keeps the last snapshot."""

    last: Snapshot

    def write(self, snapshot: Snapshot) -> None:
        self.last = snapshot


@dataclass
class Place:
    """A learner, and what actors would see of its run."""

    learner: Learner
    buffer: ReplayBuffer
    folder: RunFolder
    client: Transport
    actor: Actor
    rng: np.random.Generator
    seen: Seen

    def play(self, chunks: int) -> None:
        """An actor sends chunks of eight steps, at whose ends an episode ends."""
        for _ in range(chunks):
            self.buffer.insert(self.actor.live([*[GOES_ON] * 7, TERMINATES], self.rng))

    def checkpoint(self) -> dict[str, Any]:
        with safe_open(self.folder.checkpoint, "pt") as file:
            state: dict[str, Any] = json.loads(file.metadata()["state"])
        return state


@contextmanager
def place(runs: Path, actor: Actor, *, resume: bool, steps_goal: int | None) -> Iterator[Place]:
    """The process of a learner, from its start to its end."""
    folder = RunFolder(runs, RUN)
    folder.path.mkdir(exist_ok=True)
    device = Device(torch.device("cpu"), bfloat16=False)
    with ExitStack() as stack:
        meeting = InProcessHub()
        hub, client = (stack.enter_context(meeting.connect()) for _ in range(2))
        buffer = ReplayBuffer(CONFIG, folder.replay)
        stack.callback(buffer.close)
        stack.enter_context(ReplayServer(hub, buffer, CONFIG, RUN))
        learner = build_learner(
            LearnerOptions(CONFIG, resume=resume, steps=steps_goal, keep_snapshots=not resume),
            *(folder, hub, buffer),
            build_algorithm(CONFIG, build_network(CONFIG, 18), device),
            device,
            PlainDisplay(io.StringIO()),
            threading.Event(),
            seen := Seen(),
            sign=lambda *told: SIGNATURE,
            page=PAGE,
        )
        yield Place(learner, buffer, folder, client, actor, np.random.default_rng(1), seen)


def test_a_run_is_learned_stopped_and_continued(tmp_path: Path) -> None:
    actor = Actor("a", CONFIG.play.frame_stack)
    with place(tmp_path, actor, resume=False, steps_goal=None) as run:
        sent: list[tuple[int, bytes]] = []
        run.client.subscribe(
            RunKeys(RUN).weights,
            lambda told: sent.append(decode_version(told.attachment, run.buffer.run_id)),
        )
        run.play(5)
        assert run.learner.losses.checkpoint == run.folder.checkpoint
        run.learner.start()
        thread = threading.Thread(target=run.learner.run)
        thread.start()
        run.play(12)
        wait_until(lambda: (run.folder.snapshots / "epoch-0001.safetensors").exists(), "an epoch")
        wait_until(lambda: sent and sent[-1][0] >= 10, "weights are broadcast")
        run.learner.stop.set()
        thread.join(PATIENCE)
        assert {signature for _, signature in sent} == {SIGNATURE}
        assert run.seen.last.values["run/page"] == PAGE
        before = run.checkpoint()
        assert before["books"]["agent_steps"] == 17 * 8
        assert before["updates"] >= 10
        assert [test["epoch"] for test in before["tests"]] == [1]
        for file in (run.folder.checkpoint, run.folder.snapshots / "epoch-0001.safetensors"):
            alone = Path(shutil.copy(file, tmp_path / "alone.safetensors"))
            assert origin_of(alone) == CONFIG
    rows = (run.folder.epochs).read_text().splitlines()

    with place(tmp_path, actor, resume=True, steps_goal=18 * 8) as again:
        again.learner.start()
        assert again.learner.evaluation.snapshots.keep  # though it is not told so again
        assert not any(thread.name.startswith("prefetch") for thread in threading.enumerate())
        assert again.checkpoint() | {"seconds": 0} == before | {"seconds": 0}
        again.play(1)
        again.learner.run()
        assert again.learner.phases.done
        after = again.checkpoint()
        assert after["updates"] >= before["updates"]
        assert after["seconds"] >= before["seconds"]
        assert json.loads(again.folder.summary.read_text())["agent_steps"] == 18 * 8
    assert again.folder.epochs.read_text().splitlines()[: len(rows)] == rows

    again.folder.checkpoint.unlink()
    with place(tmp_path, actor, resume=True, steps_goal=None) as last:
        assert last.learner.phases.updates > 0
        last.learner.start()
    table = again.folder.epochs.read_bytes()
    again.folder.checkpoint.unlink()
    again.folder.previous.unlink()
    with (
        pytest.raises(InputError, match=r"is damaged or missing .* and so is .*, the one before"),
        place(tmp_path, actor, resume=True, steps_goal=None),
    ):
        pass
    assert again.folder.epochs.read_bytes() == table


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"rows": None},
        {"updates": "many"},
        {"updates": float("inf")},
        {"seconds": []},
        {"books": [1]},
        {"tests": [{"epoch": 1, "unheard_of": 2}]},
        {"actors": {"processes": [{}]}},
        {"actors": {"processes": [1]}},
        {"actors": [{"name": "a", "role": "actor", "key_times": [1, 2]}]},
        {"actors": None},
    ],
)
def test_a_checkpoint_with_other_counters_is_refused(
    tmp_path: Path, changed: dict[str, Any]
) -> None:
    """Somebody else's run may have a checkpoint whose checksum is right."""
    actor = Actor("a", CONFIG.play.frame_stack)
    with place(tmp_path, actor, resume=False, steps_goal=None) as run:
        run.play(1)
        run.learner.start()
        whole = run.checkpoint()
        run.learner.checkpoint.save(whole | changed if changed else {})
    with (
        pytest.raises(InputError, match=r"^the counters in .*\.safetensors are not those"),
        place(tmp_path, actor, resume=True, steps_goal=None),
    ):
        pass


def test_the_gpu_that_is_told_of_is_the_learners(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[torch.device] = []

    def figures(device: Device) -> dict[str, int]:
        asked.append(device.torch)
        return {"run/gpu_memory_bytes": 7}

    monkeypatch.setattr(Device, "figures", figures)
    actor = Actor("a", CONFIG.play.frame_stack)
    with place(tmp_path, actor, resume=False, steps_goal=None) as run:
        run.learner.start()
        run.learner.stop.set()
        run.learner.run()
    assert asked
    assert set(asked) == {torch.device("cpu")}

"""What strangers can send to each role, and the code that takes it in, to be fuzzed.

Everything here is the real code behind a key expression, called without a transport. It may refuse
a message by `MessageError`; whatever else it raises would be logged with a traceback, or end the
process.
"""

import math
import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from torch import nn

from actors.member import Member
from actors.stream.live_views import LiveViews
from actors.stream.weights_client import WeightsClient
from common.errors import InputError, MessageError
from common.protocol.ack import Ack
from common.protocol.chunk import Game
from common.protocol.evaluation import EvaluationJob, EvaluationReport
from common.protocol.live_view import LiveView, ViewRequest
from common.protocol.run_status import ActorStatus, HealthCheck, RunStatus
from common.protocol.weights import encode_weights, load_weights
from common.protocol.wire import encode_version
from common.run.announcement import Announcement
from common.settings.config import ProtocolConfig
from common.settings.presets import PRESETS
from common.transport.checksum import DamagedMessage, seal, unseal
from common.transport.interface import Answer, Closeable, Envelope, Request
from common.transport.signature import Signature, unsigned
from learner.evaluation.coordinator import EpochTest, EvaluationCoordinator
from learner.evaluation.service import serve_evaluators
from learner.evaluation.snapshots import Snapshots
from learner.telemetry.actor_registry import ActorRegistry
from replay.batch import SharedBatch
from replay.chunk_statistics import ReplayProgress
from replay.messages import (
    HeldOutRequest,
    HeldOutStates,
    ProgressRequest,
    SampleRequest,
)
from replay.replay_buffer import ReplayBuffer
from replay.server import ReplayServer
from tests.learner.telemetry.test_actor_registry import STATS
from tests.replay.replay_reference import GOES_ON, RUN, TERMINATES, Actor, make_config
from tests.replay.replay_requests import KEYS

FRAME_STACK = 2
"""Few frames, so that a message is small and its other fields are fuzzed too."""


class Heard:
    """A `Transport` that only notes who would answer or listen where."""

    def __init__(self) -> None:
        self.answers: dict[str, Answer] = {}
        self.callbacks: dict[str, Callable[[Envelope], None]] = {}

    def serve(self, key: str, answer: Answer) -> Closeable:
        """Note who answers at ``key``."""
        self.answers[key] = answer
        return self._nothing()

    def subscribe(self, key: str, callback: Callable[[Envelope], None]) -> Closeable:
        """Note who listens at ``key``."""
        self.callbacks[key] = callback
        return self._nothing()

    def watch_presence(self, *_: object) -> Closeable:
        """Nobody is present."""
        return self._nothing()

    def note_over_quota(self, _: str) -> None:
        """Nobody is cut off."""

    def watch_shut_out(self, *_: object) -> Closeable:
        """Nobody is shut out."""
        return self._nothing()

    def requester(self, *_: object) -> Any:
        """Nobody is asked."""
        return self._nothing()

    @staticmethod
    def _nothing() -> Closeable:
        return ExitStack()


@dataclass
class Asked:
    """A `Request` whose reply nobody reads."""

    key: str
    payload: bytes

    @property
    def size(self) -> int:
        return len(self.payload)

    def reply(self, answer: bytes | Envelope) -> None:
        """Take the answer."""

    def refuse(self, reason: str) -> None:
        """Take the refusal."""

    def drop(self) -> None:
        """End without an answer."""


@dataclass(frozen=True)
class Target:
    """One kind of message, and who takes it in."""

    seeds: tuple[bytes, ...]
    """Messages as the program itself writes them; each is accepted."""
    take: Callable[[bytes], object]
    """Raises `MessageError` or `DamagedMessage` for what it refuses."""
    seldom: bool = False
    """A seed may be refused too, once enough of its kind were taken."""


class Targets:
    """All targets by name, on real objects in ``folder``; a context manager that closes them."""

    def __init__(self, folder: Path) -> None:
        self.transport = Heard()
        self._stack = ExitStack()
        config = make_config(
            capacity=256,
            learning_starts=2,
            ratio_tolerance=10**9,
            sampler="prioritised",
            chunk_steps=8,
            frame_stack=FRAME_STACK,
            batch_size=4,
        )
        self.replay = ReplayBuffer(config, folder / "replay")
        self.replay.run_id = RUN
        self._stack.callback(self.replay.close)
        transport = cast(Any, self.transport)
        self._stack.enter_context(ReplayServer(transport, self.replay, config, RUN, math.inf))
        self.registry = ActorRegistry(transport, KEYS)
        self.registry._on_presence(KEYS.live("actor", "a1"), True)
        self.coordinator = EvaluationCoordinator(
            Snapshots(folder / "snapshots"), ProtocolConfig(), lambda: {"e"}, lambda: 0.0
        )
        self.coordinator.add(EpochTest(1, 10, 40, 40, 0.5, 100), b"w")
        serve_evaluators(transport, KEYS, self.coordinator, unsigned, most_reports=math.inf)
        member = Member("a", transport, KEYS, config, 1.0, threading.Event())
        LiveViews(member, "actor", [cast(Any, None)] * 2, cast(Any, None))
        actor, rng = Actor("a", FRAME_STACK), np.random.default_rng(0)
        self.chunks = [actor.live([GOES_ON, TERMINATES], rng) for _ in range(3)]
        for chunk in self.chunks:
            self.answer(KEYS.insert("a"), KEYS.insert("*"))(chunk.encode())
        self.all = self._requests() | self._publications() | self._answers()

    def __enter__(self) -> "Targets":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def answer(self, key: str, served: str | None = None) -> Callable[[bytes], object]:
        """Returns what a request at ``key`` comes to, of the server at ``served``."""
        answer = self.transport.answers[served or key]
        return lambda payload: answer(cast(Request, Asked(key, payload)))

    def _requests(self) -> dict[str, Target]:
        chunks = tuple(chunk.encode() for chunk in self.chunks)
        report = EvaluationReport("e", 1, 10, (Game(3.0, 9),), False)
        return {
            "insert": Target(chunks, self.answer(KEYS.insert("a"), KEYS.insert("*"))),
            "sample": Target(
                tuple(
                    SampleRequest(0, 0.0, np.arange(told), np.ones(told, np.float32)).encode()
                    for told in (0, 3)
                ),
                self._sample,
            ),
            "held_out": Target(
                (HeldOutRequest(2).encode(), HeldOutRequest(2, 2).encode()),
                self.answer(KEYS.held_out),
            ),
            "progress": Target((ProgressRequest(0, 300).encode(),), self.answer(KEYS.progress)),
            "job": Target((b"e", b"evaluator-2"), self._job),
            "report": Target(
                (report.encode(),), self.answer(KEYS.report("e"), KEYS.report("*")), seldom=True
            ),
            "view": Target(
                (ViewRequest(1, "room").encode(),),
                self.answer(KEYS.view("actor", "a")),
                seldom=True,  # eight may wait, and no one plays here
            ),
        }

    def _job(self, name: bytes) -> object:
        """An evaluator says its name in the key."""
        return self.answer(KEYS.job(name.decode(errors="replace")), KEYS.job("*"))(b"")

    def _sample(self, payload: bytes) -> object:
        """A draw that finds too little waits as long as it is told, at most a second: not here."""
        asked = SampleRequest.decode(payload)
        return self.answer(KEYS.sample)(replace(asked, timeout=0.0).encode())

    def _publications(self) -> dict[str, Target]:
        heartbeats = self.transport.callbacks[KEYS.stats("*", "*")]
        weights = self.transport.callbacks[KEYS.weights]  # the replay's
        actor = WeightsClient(cast(Any, self.transport), KEYS)._receive
        network = nn.Linear(3, 2)  # small, so that its header is a good part of the message

        def both(attachment: bytes) -> None:
            weights(Envelope(b"weights", attachment, KEYS.weights))
            actor(Envelope(b"weights", attachment, KEYS.weights))

        return {
            "stats": Target(
                (STATS.encode(), replace(STATS, leaving=True).encode()),
                lambda payload: heartbeats(Envelope(payload, b"", KEYS.stats("actor", "a1"))),
            ),
            "version": Target((encode_version(7, RUN), encode_version(7, RUN, b"s")), both),
            "weights": Target((encode_weights(network),), lambda data: load_weights(network, data)),
        }

    def _answers(self) -> dict[str, Target]:
        held = self.transport.answers[KEYS.held_out]
        drawn = self.replay.sample_shared(0, 0.0)
        assert drawn is not None
        config = PRESETS["robot"]
        status = RunStatus(
            "0.1.0",
            0.5,
            {"learning/updates": 3, "run/phase": "training", "learning/loss": 0.25},
            (HealthCheck("sees", 0.9, "≥ 0.5", True, "", True),),
            (ActorStatus("a", "actor", True, False, 0.1, "0.1.0", 12.5, 3, 0.0),),
        )
        view = LiveView(
            1, 2.0, 5, True, False, b"", (), (), b"", b"", 1, 1, (0, 2, 5), (0.5, 0.25, 1.0), 2
        )
        sealed = seal("key", b"payload", b"attachment")
        held_out = held(cast(Request, Asked(KEYS.held_out, HeldOutRequest(2).encode())))
        assert isinstance(held_out, bytes)
        return {
            "ack": Target((Ack("stored", False, False, 9, 1.0, 3, RUN).encode(),), Ack.decode),
            "announcement": Target(
                (Announcement("r", config, config.action_count, RUN).encode(),),
                _announced,
            ),
            "batch": Target((drawn.encode(),), lambda payload: SharedBatch.decode(payload).whole()),
            "held_out_states": Target((held_out,), HeldOutStates.decode),
            "progress_told": Target((self.replay.progress(0).encode(),), ReplayProgress.decode),
            "job": Target((EvaluationJob("test", 1, 9, 0.1, b"w").encode(),), EvaluationJob.decode),
            "live_view": Target((view.encode(),), LiveView.decode),
            "run_status": Target((status.encode(),), RunStatus.decode),
            "signature": Target((Signature(b"der", b"signed").encode(),), Signature.decode),
            "seal": Target((sealed,), lambda data: unseal("key", b"payload", data)),
        }


def _announced(payload: bytes) -> Announcement:
    """What `find_run` makes of an announcement: settings that it refuses are a person's matter."""
    try:
        return Announcement.decode(payload)
    except InputError as error:
        raise MessageError(str(error)) from None


REFUSED = (MessageError, DamagedMessage)

"""Requests without an answer: sent again ever more seldom, and told once."""

import errno
from collections.abc import Callable
from concurrent.futures import Future
from types import SimpleNamespace

import pytest

from common.errors import MessageError
from common.process import log_lines
from common.transport import requests
from common.transport.interface import Envelope, Request, Unanswered
from common.transport.requests import LONGEST_REASON, Window, answer_request


class Clock:
    now = 1_000.0


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    for module in (requests, log_lines):
        monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock.now))
    return clock


class Away:
    """A server that is there and never answers."""

    has_server = True

    def __init__(self, clock: Clock) -> None:
        self.asked: list[float] = []
        self._clock = clock

    def request(self, payload: bytes) -> Future[Envelope]:
        self.asked.append(self._clock.now)
        future: Future[Envelope] = Future()
        future.set_exception(Unanswered())
        return future

    def close(self) -> None: ...


def test_a_request_is_sent_again_ever_more_seldom(clock: Clock) -> None:
    server = Away(clock)
    window = Window(server, lambda outcome: None)
    window.send(b"chunk")
    while clock.now < 1_040.0:
        window.wait(0, 0.0)
        clock.now += 0.05
    pauses = [later - before for before, later in zip(server.asked, server.asked[1:], strict=False)]
    assert pauses == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.6, 3.2, *[5.0] * 6], abs=0.06)


def test_a_request_that_is_under_way_is_not_sent_again(clock: Clock) -> None:
    class Slow(Away):
        """It loses the first request, and takes its time for others."""

        def request(self, payload: bytes) -> Future[Envelope]:
            lost = super().request(payload)
            return lost if len(self.asked) == 1 else Future()

    window = Window(server := Slow(clock), lambda outcome: None)
    window.send(b"chunk")
    while clock.now < 1_040.0:
        window.wait(0, 0.0)
        clock.now += 0.05
    assert len(server.asked) == 2
    assert window.sent_again == 1


class Asked:
    """A request that the test makes."""

    key = "k"
    size = 0
    payload = b""

    def __init__(self) -> None:
        self.ended: list[str] = []

    def reply(self, answer: bytes | Envelope) -> None:
        self.ended.append("reply")

    def refuse(self, reason: str) -> None:
        self.ended.append(reason)

    def drop(self) -> None:
        self.ended.append("drop")


def failing(error: Exception) -> Callable[[Request], bytes]:
    def answer(request: Request) -> bytes:
        raise error

    return answer


def test_a_full_disk_is_told_in_a_line_now_and_then(
    clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    request, full = Asked(), failing(OSError(errno.ENOSPC, "No space left on device"))
    for _ in range(1_000):
        answer_request(request, full)
        clock.now += 0.025
    assert request.ended == ["drop"] * 1_000
    assert len(caplog.messages) == 3
    assert caplog.messages[0].endswith("k found no answer: [Errno 28] No space left on device")
    assert not any(record.exc_info for record in caplog.records)


def test_a_refusal_does_not_repeat_all_that_is_refused() -> None:
    request = Asked()
    answer_request(request, failing(MessageError("x" * 10**6)))
    assert request.ended == ["x" * LONGEST_REASON]

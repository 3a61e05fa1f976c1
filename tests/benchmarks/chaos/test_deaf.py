"""It tells which connections recover, which have to be made anew, and which stay deaf."""

from collections.abc import Callable

import pytest

from benchmarks.chaos import deaf
from benchmarks.chaos.deaf import Options
from benchmarks.chaos.link import Link
from benchmarks.child import free_endpoint
from common.transport.chosen import open_hub
from common.transport.interface import Request


def _drop(request: Request) -> None:
    request.drop()


def _take(request: Request) -> bytes:
    return b"taken"


@pytest.mark.parametrize(("answer", "recovers"), [(_take, True), (_drop, False)])
def test_a_connection_has_recovered_once_all_is_answered(
    monkeypatch: pytest.MonkeyPatch, answer: Callable[[Request], bytes | None], recovers: bool
) -> None:
    # Which wrong bits break a connection is chance, so none are wrong here.
    monkeypatch.setattr(Link, "_spoiled", lambda self, content: content)
    endpoint = free_endpoint()
    with open_hub(endpoint) as hub:
        hub.serve("run/*/insert", answer)
        # A request is given up after 5 s, so one that is answered by then needs no second try.
        options = Options(wrong=0.05, longest=30.0 if recovers else 0.5)
        took = deaf.break_one(options, endpoint, number=3)
    assert (took is not None) == recovers


def test_bits_are_wrong_while_inserts_are_under_way(monkeypatch: pytest.MonkeyPatch) -> None:
    draws = []

    def note(link: Link, content: bytes) -> bytes:
        draws.append(link.flips)
        return content

    monkeypatch.setattr(Link, "_spoiled", note)
    endpoint = free_endpoint()
    with open_hub(endpoint) as hub:
        hub.serve("run/*/insert", _take)
        deaf.break_one(Options(wrong=0.2, seed=5), endpoint, number=3)
    broken = [each for each in draws if each is not None]
    assert broken
    assert draws[0] is None  # the client finds its hub first
    assert len({id(each) for each in broken}) == 1


def test_the_report_counts_each_connection_once() -> None:
    found = deaf.report(Options(seed=7), [0.5, 1.5, 19.0, 21.0, 45.0, None])
    assert found.content["rows"] == [
        {
            "connections": 6,
            "median s": 1.5,
            "deaf": 3,
            "made anew": 2,
            "longest s": 45.0,
            "never": 1,
        }
    ]
    assert found.content["seed"] == 7
    assert found.content["seconds"] == [0.5, 1.5, 19.0, 21.0, 45.0, None]


def test_a_report_without_any_answer_has_no_times() -> None:
    (row,) = deaf.report(Options(), [None]).content["rows"]
    assert (row["median s"], row["longest s"], row["deaf"], row["never"]) == (None, None, 1, 1)

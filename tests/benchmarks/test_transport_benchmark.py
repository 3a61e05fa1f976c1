"""`benchmarks.transport` with real processes, for a moment."""

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks import transport
from benchmarks.report import run
from common.command_line.parser import check_bounds
from common.errors import InputError


@pytest.mark.usefixtures("forks")
def test_chunks_and_batches_at_once() -> None:
    options = transport.Options(seconds=0.3, capacity=2_000, chunk_steps=16)
    with transport.Exchange(options) as exchange:
        sent, drawn = exchange.measure(["send", "draw"])
        again = exchange.measure(["send"], window=1)[0]
    for each in (sent, again):
        assert each["transitions_per_second"] == pytest.approx(16 * each["calls_per_second"])
        # 16 frames and 3 of context of 7,056 bytes, compressed.
        size = each["megabytes_per_second"] * 1e6 / each["calls_per_second"]
        assert 2_000 < size < 19 * 7_056 / 5
        assert each["unacknowledged"] == each["refused"] == 0
    assert drawn["transitions_per_second"] == pytest.approx(32 * drawn["calls_per_second"])
    size = drawn["megabytes_per_second"] * 1e6 / drawn["calls_per_second"]
    assert 10_000 < size < 2 * 32 * 4 * 7_056 / 10
    for each in (sent, drawn, again):
        assert 0 < each["p50_ms"] <= each["p99_ms"]
        assert each["calls"] == pytest.approx(each["calls_per_second"] * each["seconds"])
        assert each["seconds"] >= 0.3


@pytest.mark.usefixtures("forks")
def test_a_sender_keeps_to_its_pace() -> None:
    with transport.Exchange(transport.Options(seconds=1.0, capacity=2_000)) as exchange:
        (sent,) = exchange.measure(["send"], pace=320)
    # A chunk of 64 steps every 0.2 s; what is missed in the 0.3 s of warming up is made up for.
    assert sent["calls"] <= 5 * sent["seconds"] + 3


def figures(**changed: float) -> dict[str, Any]:
    return {
        "calls": 10,
        "seconds": 2.0,
        "calls_per_second": 5.0,
        "p50_ms": 1.0,
        "p99_ms": 2.0,
        "transitions_per_second": 320.0,
        "megabytes_per_second": 2.5,
        "retried": 0,
    } | changed


def test_several_senders_together() -> None:
    found = transport.together([figures(), figures(p99_ms=9.0, p50_ms=0.5, retried=1)])
    assert found == {
        "calls": 20,
        "seconds": 2.0,
        "calls_per_second": 10.0,
        "p50_ms": 1.0,
        "p99_ms": 9.0,
        "transitions_per_second": 640.0,
        "megabytes_per_second": 5.0,
        "retried": 1,
    }


def test_table_and_json(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    class Told:
        def __init__(self, *_: object) -> None: ...
        def __enter__(self) -> "Told":
            return self

        def __exit__(self, *_: object) -> None: ...
        def measure(
            self, roles: list[str], window: int = 4, pace: float | None = None
        ) -> list[dict[str, Any]]:
            assert pace in {None, 10_000.0}
            rate = (5.0 * window) if len(set(roles)) == 1 else 1.0 if pace is None else 3.0
            return [figures(calls_per_second=rate) for _ in roles]

    results = tmp_path / "transport.json"
    monkeypatch.setattr(transport, "Exchange", Told)
    arguments = ["--senders", "2", "--json", str(results)]
    run("transport", transport.Options, transport.measure, arguments)
    found = json.loads(results.read_text())
    assert found["insert_one_at_a_time"]["calls_per_second"] == 5.0
    assert found["insert"]["calls_per_second"] == 40.0
    assert found["sample"]["calls_per_second"] == 20.0
    assert found["insert_at_once"]["calls_per_second"] == 2.0
    assert found["sample_at_once"]["calls_per_second"] == 1.0
    assert found["insert_paced"]["calls_per_second"] == 6.0
    assert found["sample_beside_paced"]["calls_per_second"] == 3.0
    assert len(found["rows"]) == 7
    assert "at once" in capsys.readouterr().out


def test_settings_that_cannot_work() -> None:
    with pytest.raises(InputError, match="senders"):
        check_bounds(transport.Options(senders=0))

"""Finding a run at a hub."""

import logging
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from common.errors import InputError, Unreachable
from common.protocol.run_keys import RunKeys
from common.protocol.wire import SCHEMA, pack
from common.run import join
from common.run.announcement import Announcement
from common.run.join import find_run, patiently
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from common.transport.interface import Closeable, Transport
from tests.patience import PATIENCE

FAST, PAPER = PRESETS["fast"], PRESETS["paper"]


def announce(hub: Transport, run: str, answer: bytes) -> Closeable:
    """Answer as the hub of ``run``."""
    return hub.serve(RunKeys(run).config, lambda _: answer)


def announcement(run: str, config: RunConfig) -> bytes:
    return Announcement(run, config, config.action_count, f"id-{run}").encode()


def never() -> bool:
    return False


def test_a_run_is_found_by_its_name(hub: Transport, client: Transport) -> None:
    announce(hub, "one", announcement("one", FAST))
    announce(hub, "two", announcement("two", PAPER))
    assert find_run(client, "one", PATIENCE, never) == (RunKeys("one", "id-one"), FAST)
    assert find_run(client, "two", PATIENCE, never) == (RunKeys("two", "id-two"), PAPER)


def test_the_only_run_is_found_without_a_name(hub: Transport, client: Transport) -> None:
    announce(hub, "one", announcement("one", PAPER))
    assert find_run(client, None, PATIENCE, never) == (RunKeys("one", "id-one"), PAPER)


def test_of_several_runs_one_must_be_named(hub: Transport, client: Transport) -> None:
    announce(hub, "two", announcement("two", FAST))
    announce(hub, "one", announcement("one", FAST))
    with pytest.raises(InputError, match=r"several runs \(one, two\): name one with --run"):
        find_run(client, None, PATIENCE, never)


def test_a_run_that_cannot_be_played_here_is_passed_over_for_one_that_can(
    hub: Transport, client: Transport
) -> None:
    # Its package is not installed here, or has another version.
    unknown = replace(FAST, env="unheard-of")
    announce(hub, "b", Announcement("b", unknown, 6, "id-b").encode())
    announce(hub, "a", Announcement("a", FAST, FAST.action_count + 1, "id-a").encode())
    announce(hub, "one", announcement("one", FAST))
    assert find_run(client, None, PATIENCE, never) == (RunKeys("one", "id-one"), FAST)
    with pytest.raises(InputError, match="unheard-of"):
        find_run(client, "b", PATIENCE, never)
    with pytest.raises(InputError, match=r"has 7 actions at the hub and 6 here"):
        find_run(client, "a", PATIENCE, never)


def test_of_runs_that_cannot_be_played_here_one_is_told(hub: Transport, client: Transport) -> None:
    announce(hub, "b", Announcement("b", replace(FAST, env="unheard-of"), 6, "id-b").encode())
    announce(hub, "a", Announcement("a", FAST, FAST.action_count + 1, "id-a").encode())
    with pytest.raises(InputError, match=r"has 7 actions at the hub and 6 here"):
        find_run(client, None, 0.0, never)


def test_a_run_that_could_not_be_played_and_has_ended_is_not_told(
    hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    times = iter((0.0, 0.0, 9.0))
    time = SimpleNamespace(monotonic=lambda: next(times), sleep=lambda _: None)
    monkeypatch.setattr("common.run.join.time", time)
    unfit = announce(hub, "a", Announcement("a", FAST, FAST.action_count + 1, "id-a").encode())

    def ends() -> bool:
        unfit.close()
        return False

    with pytest.raises(Unreachable, match="the hub serves no run"):
        find_run(client, None, 9.0, ends)


def test_who_answers_for_one_run_cannot_speak_of_another(hub: Transport, client: Transport) -> None:
    announce(hub, "other", announcement("one", PAPER))
    with pytest.raises(InputError, match="the hub serves no run"):
        find_run(client, None, 0.0, never)
    announce(hub, "one", announcement("one", FAST))
    assert find_run(client, None, PATIENCE, never) == (RunKeys("one", "id-one"), FAST)


def test_no_run_is_told_after_the_patience(client: Transport) -> None:
    with pytest.raises(InputError, match=r"^the hub serves no run: start a learner there\.$"):
        find_run(client, None, 0.0, never)


def test_who_shows_a_certificate_hears_that_it_may_be_of_no_use(client: Transport) -> None:
    words = r"start a learner there\. If one runs there, it does not admit our certificate: use"
    with pytest.raises(InputError, match=words):
        find_run(client, None, 0.0, never, Path("certificates"))


def test_a_run_that_is_not_there_is_told_by_name(hub: Transport, client: Transport) -> None:
    announce(hub, "one", announcement("one", FAST))
    announce(hub, "two", announcement("two", FAST))
    told = "the hub serves no run called 'other', but one and two: name one with --run, or start a"
    with pytest.raises(InputError, match=f"^{told} learner there"):
        find_run(client, "other", 0.0, never)


def test_who_waits_for_a_run_hears_at_once_which_others_there_are(
    hub: Transport,
    client: Transport,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The usual one tells the same seldom, and another test may just have heard it.
    monkeypatch.setattr(join, "_log", logging.getLogger("join"))
    announce(hub, "one", announcement("one", FAST))
    asked = iter((False, False, True))
    with pytest.raises(KeyboardInterrupt):
        find_run(client, "other", PATIENCE, lambda: next(asked))
    assert caplog.messages == ["the hub serves one, and no run called other"]


def begins_after_two_looks(hub: Transport, run: str) -> Mock:
    """Returns a callback that announces ``run`` when it is called for the second time."""

    def called() -> bool:
        if stopped.call_count == 2:
            announce(hub, run, announcement(run, FAST))
        return False

    stopped = Mock(side_effect=called)
    return stopped


def test_a_run_that_starts_later_is_waited_for(hub: Transport, client: Transport) -> None:
    stopped = begins_after_two_looks(hub, "late")
    assert find_run(client, None, PATIENCE, stopped)[0] == RunKeys("late", "id-late")
    assert stopped.call_count >= 2


def test_whoever_wants_to_stop_need_not_wait(client: Transport) -> None:
    with pytest.raises(KeyboardInterrupt):
        find_run(client, None, 1e9, lambda: True)


def test_a_hub_of_another_version_is_told(hub: Transport, client: Transport) -> None:
    good = announcement("one", FAST)
    for answer in (
        b"",
        b"garbage",
        pack({"run": "one"}),
        pack({"run": "one", "config": {}, "actions": 6, "run_id": "id"}),
        pack({"run": 1, "config": FAST, "actions": 6, "run_id": "id"}),
        pack({"run": "one", "config": {**vars(FAST), "play": {}}, "actions": 6, "run_id": "id"}),
        good.replace(b"schema" + bytes([SCHEMA]), b"schema\x63"),
    ):
        assert answer != good
        service = announce(hub, "one", answer)
        for name, patience in (("one", PATIENCE), (None, 0.0)):
            with pytest.raises(InputError, match="use the same version on both sides, or name"):
                find_run(client, name, patience, never)
        service.close()


def test_who_announces_what_cannot_be_played_keeps_nobody_from_a_run_that_comes_later(
    hub: Transport, client: Transport, caplog: pytest.LogCaptureFixture
) -> None:
    announce(hub, "bad", b"garbage")
    announce(hub, "unfit", Announcement("unfit", FAST, FAST.action_count + 1, "id").encode())
    announce(hub, "worse", announcement("*", FAST))
    found = find_run(client, None, PATIENCE, begins_after_two_looks(hub, "one"))
    assert found == (RunKeys("one", "id-one"), FAST)
    passed_over = sorted(record.getMessage().split(":")[0] for record in caplog.records)
    assert passed_over == [
        f"what {RunKeys(run).config} announces is passed over" for run in ("bad", "unfit", "worse")
    ]


def test_a_name_that_is_no_key_is_told(client: Transport) -> None:
    with pytest.raises(InputError, match="'a//b' cannot be used"):
        find_run(client, "a//b", 0.0, never)


def test_whoever_waits_says_so_at_once_and_every_ten_seconds() -> None:
    said: list[str] = []
    stop, now = threading.Event(), 0.0
    stopped = patiently(stop, "tcp/hub:7447", 300.0, said.append, lambda: now)
    told = []
    for now in (0.0, 5.0, 10.0, 19.9, 20.0):  # noqa: B007 - the clock reads it
        assert not stopped()
        told.append(len(said))
    assert told == [1, 1, 2, 2, 3]
    assert said == [
        "waiting at most 300 s for a run at tcp/hub:7447: a learner at another address is named by "
        "--connect; Ctrl-C ends it.",
        "waiting at most 290 s for a run at tcp/hub:7447; Ctrl-C ends it.",
        "waiting at most 280 s for a run at tcp/hub:7447; Ctrl-C ends it.",
    ]
    stop.set()
    assert stopped()
    assert len(said) == 3

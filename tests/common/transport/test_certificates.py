"""Hubs and clients with certificates of `deploy/certificates.sh`, over real connections."""

import os
import pty
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from itertools import cycle
from pathlib import Path
from queue import SimpleQueue

import pytest

from benchmarks.chaos.certificates import expired
from common.errors import InputError
from common.exit_codes import BAD_INPUT
from common.protocol.live_view import MAX_VIEW_BYTES
from common.protocol.run_keys import RunKeys
from common.transport.credentials import Role, check_certificates, own_name
from common.transport.interface import Request, Transport
from common.transport.zenoh_sessions import connect, open_hub
from tests.certificates import SCRIPT, certify
from tests.paths import ROOT
from tests.patience import PATIENCE, wait_until

KEYS = RunKeys("r")
NOT_LET_IN = r"^no hub answered at t"


@pytest.fixture
def hub(address: str, certificates: Path) -> Iterator[Transport]:
    with open_hub(address, certificates) as transport:
        yield transport


@pytest.fixture
def join(hub: Transport, address: str, certificates: Path) -> Iterator[Callable[[Role], Transport]]:
    """Clients of the hub."""
    transports: list[Transport] = []

    def one(role: Role) -> Transport:
        transports.append(connect(address, PATIENCE, role=role, certificates=certificates))
        return transports[-1]

    yield one
    for transport in transports:
        transport.close()


def ask(
    transport: Transport, key: str, payload: bytes = b"", deadline: float = PATIENCE
) -> list[bytes]:
    return [answer.payload for answer in transport.gather(key, deadline, payload)]


QUERIES = {
    "config": KEYS.config,
    "insert": KEYS.insert("a"),
    "latest_weights": KEYS.latest_weights,
    "job": KEYS.job("a"),
    "report": KEYS.report("a"),
    "sample": KEYS.sample,
    "held_out": KEYS.held_out,
    "progress": KEYS.progress,
    "status": KEYS.status,
    "view": KEYS.view("actor", "a"),
}


@pytest.mark.parametrize(
    ("role", "allowed"),
    [
        ("actor", {"config", "insert", "latest_weights", "job", "report"}),
        ("learner", {"config", "sample", "held_out", "progress", "status", "view"}),
    ],
)
def test_each_role_is_answered_what_it_may_ask(
    hub: Transport, join: Callable[[Role], Transport], role: Role, allowed: set[str]
) -> None:
    hub.serve(KEYS.all, lambda _: b"ok")
    transport = join(role)
    assert {name for name, key in QUERIES.items() if ask(transport, key) == [b"ok"]} == allowed
    # Whoever asks for all at once gets nothing either.
    assert ask(transport, KEYS.all) == []


@pytest.mark.parametrize(
    ("role", "denied", "allowed"),
    [
        ("actor", KEYS.weights, KEYS.stats("actor", "a")),
        ("actor", KEYS.stats("learner", "a"), KEYS.stats("evaluator", "e")),
        ("learner", KEYS.stats("actor", "a"), KEYS.weights),
    ],
)
def test_each_role_tells_what_it_may_tell(
    hub: Transport,
    join: Callable[[Role], Transport],
    role: Role,
    denied: str,
    allowed: str,
) -> None:
    heard: list[str] = []
    hub.subscribe(KEYS.all, lambda message: heard.append(message.key))
    transport = join(role)
    turns = cycle([transport.publisher(key) for key in (denied, allowed)])

    def tell() -> bool:
        next(turns).publish(b"")  # one at a time: two at once would be too often
        return len(heard) >= 3

    wait_until(tell, "what is allowed is heard")
    assert set(heard) == {allowed}


def test_an_actor_lives_as_an_actor_alone(
    hub: Transport, join: Callable[[Role], Transport]
) -> None:
    heard: SimpleQueue[tuple[str, bool]] = SimpleQueue()
    hub.watch_presence(KEYS.live("*", "*"), lambda *news: heard.put(news))
    transport = join("actor")
    for role in ("learner", "evaluator"):
        transport.announce(KEYS.live(role, "a"))
    assert heard.get(timeout=PATIENCE) == (KEYS.live("evaluator", "a"), True)


def test_an_actor_hears_weights_and_not_others(
    hub: Transport, join: Callable[[Role], Transport]
) -> None:
    transport = join("actor")
    heard: list[str] = []
    for key in (KEYS.stats("*", "*"), KEYS.weights):
        transport.subscribe(key, lambda message: heard.append(message.key))
    publishers = [hub.publisher(key) for key in (KEYS.stats("actor", "other"), KEYS.weights)]

    def hear_weights() -> bool:
        for publisher in publishers:
            publisher.publish(b"")
        return bool(heard)

    wait_until(hear_weights, "weights are heard")
    assert set(heard) == {KEYS.weights}


def test_an_actor_cannot_answer_for_the_hub(
    hub: Transport, join: Callable[[Role], Transport]
) -> None:
    rogue = join("actor")
    rogue.serve(KEYS.config, lambda _: b"forged")
    hub.serve(KEYS.latest_weights, lambda _: b"truly the hub's")
    assert ask(rogue, KEYS.latest_weights) == [b"truly the hub's"]  # so all before has arrived
    assert ask(join("actor"), KEYS.config) == []


def test_a_learner_sees_what_an_actor_shows(
    hub: Transport, join: Callable[[Role], Transport]
) -> None:
    """Through the hub; what is longer than a view is dropped there."""

    def view(length: int, request: Request) -> bytes:
        return request.payload + bytes(length)

    learner, actor = join("learner"), join("actor")
    for name, length in (("a", MAX_VIEW_BYTES), ("b", 2 * MAX_VIEW_BYTES + 1)):
        actor.serve(KEYS.view("actor", name), partial(view, length))
    wait_until(
        lambda: ask(learner, KEYS.view("actor", "a"), b"?") == [b"?" + bytes(MAX_VIEW_BYTES)],
        "the view has come",
    )
    assert ask(learner, KEYS.view("actor", "b"), b"?", 0.2) == []


def test_a_learner_is_heard_by_name(hub: Transport, join: Callable[[Role], Transport]) -> None:
    """Evaluators ask the learner for jobs, through the hub."""
    learner, actor = join("learner"), join("actor")

    learner.serve(KEYS.job("*"), lambda _: b"job")
    wait_until(lambda: ask(actor, KEYS.job("e")) == [b"job"], "the actor has its job")


# ---------------------------------------------------------------------- actors by name


@pytest.fixture
def enter(address: str, named: Path) -> Iterator[Callable[[str | None], Transport]]:
    """A hub that serves and hears all, and clients of it by name; None has the role's certificate.

    They have all files but the list, as on another machine.
    """
    place = shutil.copytree(named, named.with_name("elsewhere"))
    (place / "actors.txt").unlink()
    with ExitStack() as stack:
        hub = stack.enter_context(open_hub(address, named))
        hub.serve(KEYS.all, lambda request: request.key.encode())
        yield lambda name: stack.enter_context(
            connect(address, PATIENCE, name=name, certificates=place)
        )


def own_keys(name: str) -> list[str]:
    return [KEYS.insert(name), KEYS.job(name), KEYS.report(name)]


def test_an_actor_asks_in_its_own_name_alone(enter: Callable[[str | None], Transport]) -> None:
    left = enter("left")
    for key in (*own_keys("left"), KEYS.config, KEYS.latest_weights):
        assert ask(left, key) == [key.encode()]
    for key in (*own_keys("right"), *own_keys("*"), KEYS.sample, KEYS.all):
        assert ask(left, key, b"", 0.2) == []
    assert ask(enter("right"), KEYS.insert("right")) == [KEYS.insert("right").encode()]


def test_an_actor_tells_lives_and_shows_in_its_own_name_alone(
    address: str, named: Path, enter: Callable[[str | None], Transport]
) -> None:
    left, learner = enter("left"), connect(address, PATIENCE, role="learner", certificates=named)
    with learner:
        heard: set[str] = set()
        learner.subscribe(KEYS.stats("*", "*"), lambda message: heard.add(message.key))
        learner.watch_presence(KEYS.live("*", "*"), lambda key, _: heard.add(key))
        names = ("right", "left")
        turns = cycle([left.publisher(KEYS.stats("actor", name)) for name in names])
        for name in names:
            left.announce(KEYS.live("actor", name))
            left.serve(
                KEYS.view("actor", name), lambda request: b"shown at " + request.key.encode()
            )

        def tell() -> bool:
            next(turns).publish(b"")  # one at a time: two at once would be too often
            return len(heard) >= 2

        wait_until(tell, "left is heard")
        assert heard == {KEYS.live("actor", "left"), KEYS.stats("actor", "left")}
        shown = f"shown at {KEYS.view('actor', 'left')}".encode()
        wait_until(lambda: shown in ask(learner, KEYS.view("actor", "left")), "left is seen")
        assert ask(learner, KEYS.view("actor", "right")) == [KEYS.view("actor", "right").encode()]


def test_where_actors_have_names_their_role_is_not_enough(
    enter: Callable[[str | None], Transport],
) -> None:
    anybody = enter(None)
    for key in (KEYS.config, *own_keys("left"), KEYS.latest_weights):
        assert ask(anybody, key, b"", 0.2) == []


def test_a_name_that_is_deleted_is_out_when_the_hub_starts_again(
    address: str, named: Path, tmp_path: Path
) -> None:
    place = shutil.copytree(named, tmp_path / "elsewhere")
    (place / "actors.txt").unlink()
    (named / "actors.txt").write_text("right\n")
    with open_hub(address, named) as hub:
        hub.serve(KEYS.all, lambda _: b"ok")
        for name, answer in (("right", [b"ok"]), ("left", [])):
            with connect(address, PATIENCE, name=name, certificates=place) as actor:
                assert ask(actor, KEYS.insert(name), b"", PATIENCE if answer else 0.2) == answer


def test_a_hub_knows_who_connects_and_may_do_nothing(address: str, named: Path) -> None:
    place = shutil.copytree(named, named.with_name("elsewhere"))
    (place / "actors.txt").unlink()
    (named / "actors.txt").write_text("right\n")
    told: SimpleQueue[tuple[str, str]] = SimpleQueue()

    def join(*names: str | None) -> None:
        for name in names:
            connect(address, PATIENCE, name=name, certificates=place).close()

    with open_hub(address, named) as hub:
        hub.watch_shut_out(lambda *who: told.put(who))
        join("right", "left", None)
        connect(address, PATIENCE, role="learner", certificates=place).close()
        join("left")
        found = [told.get(timeout=PATIENCE) for _ in range(3)]
    host = "127.0.0.1"
    assert found == [("actor.left", host), ("actor", host), ("actor.left", host)]
    assert told.empty()


def test_a_hub_tells_who_was_there_before_it_was_asked(address: str, named: Path) -> None:
    (named / "actors.txt").write_text("left\n")
    told: SimpleQueue[tuple[str, str]] = SimpleQueue()
    with open_hub(address, named) as hub, connect(address, PATIENCE, certificates=named):
        hub.watch_shut_out(lambda *who: told.put(who))
        assert told.get(timeout=PATIENCE) == ("actor", "127.0.0.1")


def test_a_hub_that_lists_nobody_lets_no_actor_in(address: str, named: Path) -> None:
    (named / "actors.txt").write_text("")
    with open_hub(address, named) as hub:
        hub.serve(KEYS.all, lambda _: b"ok")
        with connect(address, PATIENCE, certificates=named) as actor:
            assert ask(actor, KEYS.config, b"", 0.2) == []
        with connect(address, PATIENCE, role="learner", certificates=named) as learner:
            assert ask(learner, KEYS.config) == [b"ok"]


def test_a_certificate_made_anew_is_the_same_actor(address: str, named: Path) -> None:
    before = (named / "actor.left.pem").read_bytes()
    listed = (named / "actors.txt").read_text()
    certify(named, "--actors", "left", "third")
    assert (named / "actor.left.pem").read_bytes() != before
    assert (named / "actors.txt").read_text() == f"{listed}third\n" == "left\nright\nthird\n"
    with open_hub(address, named) as hub:
        hub.serve(KEYS.all, lambda _: b"ok")
        with connect(address, PATIENCE, name="left", certificates=named) as actor:
            assert ask(actor, KEYS.insert("left")) == [b"ok"]


@pytest.mark.parametrize(
    ("text", "words"),
    [("left\n../x\n", r"actors.txt holds '../x', which"), ("ä\n", "actors.txt cannot be read")],
)
def test_a_list_that_cannot_be_one_is_told(
    address: str, named: Path, text: str, words: str
) -> None:
    (named / "actors.txt").write_text(text)
    with pytest.raises(InputError, match=words):
        open_hub(address, named)


def test_a_list_that_was_lost_lets_nobody_in_by_accident(address: str, named: Path) -> None:
    (named / "actors.txt").unlink()
    with pytest.raises(InputError, match=r"by name, but no .*actors.txt: put the list back"):
        open_hub(address, named)


def test_a_list_edited_by_hand_is_gone_on_with(named: Path) -> None:
    (named / "actors.txt").write_text("left\nright")
    certify(named, "--actors", "third")
    assert (named / "actors.txt").read_text() == "left\nright\nthird\n"


def test_an_actor_that_is_not_on_the_list_beside_it_is_told(address: str, named: Path) -> None:
    with pytest.raises(InputError, match=r"actors.txt does not list actor-1: make .* --actors a"):
        check_certificates(address, named, "actor", "actor-1")


def test_a_folder_with_one_name_says_who_its_process_is(named: Path, certificates: Path) -> None:
    assert own_name(certificates) is None
    with pytest.raises(InputError, match=r"has certificates of left, right: choose"):
        own_name(named)
    for end in (".pem", "-key.pem"):
        (named / f"actor.right{end}").unlink()
    assert own_name(named) == "left"


@pytest.mark.parametrize("name", ["-a", "a/b", "a b", "", "a" * 59])
def test_the_script_makes_nothing_for_what_cannot_be_a_name(named: Path, name: str) -> None:
    before = sorted(named.iterdir())
    ended = subprocess.run(
        [SCRIPT, named, "--actors", "good", name], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.startswith("error: no actor can be called")
    assert sorted(named.iterdir()) == before


def test_the_script_names_no_actor_without_an_authority(tmp_path: Path) -> None:
    ended = subprocess.run(
        [SCRIPT, tmp_path / "x", "--actors", "a"], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stdout) == (2, "")
    assert "make an authority" in ended.stderr


# ---------------------------------------------------------------------- runs that share a hub

OTHER = RunKeys("other")


@pytest.fixture(scope="module")
def _shared(certificates: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = shutil.copytree(certificates, tmp_path_factory.mktemp("shared") / "all")
    return certify(folder, "--runs", "other")


@pytest.fixture
def shared(_shared: Path, tmp_path: Path) -> Path:
    """A folder of a hub that lets the replay of another run in."""
    return shutil.copytree(_shared, tmp_path / "shared")


@pytest.fixture
def other_replay(address: str, shared: Path) -> Iterator[Transport]:
    """The replay of that run, at the hub, which answers as that of ``r``."""
    with (
        open_hub(address, shared) as hub,
        connect(address, PATIENCE, role="replay", name="other", certificates=shared) as replay,
    ):
        hub.serve(KEYS.config, lambda _: b"the hub's")
        yield replay


def test_a_replay_at_the_hub_of_another_run_answers_for_its_own_alone(
    address: str, shared: Path, other_replay: Transport
) -> None:
    def served(keys: RunKeys) -> list[str]:
        inserts, own = keys.insert("*"), (keys.config, keys.latest_weights, keys.sample)
        return [*own, keys.held_out, keys.progress, inserts]

    for key in (*served(KEYS), KEYS.job("*"), OTHER.job("*"), *served(OTHER)):
        other_replay.serve(key, lambda request: request.key.encode())
    with (
        connect(address, PATIENCE, role="learner", certificates=shared) as learner,
        connect(address, PATIENCE, certificates=shared) as actor,
    ):
        insert, weights = OTHER.insert("a"), OTHER.latest_weights
        wait_until(lambda: ask(actor, insert) == [insert.encode()], "it answers")
        assert ask(actor, weights) == [weights.encode()]
        for key in (OTHER.sample, OTHER.held_out, OTHER.progress):
            assert ask(learner, key) == [key.encode()]
        runs = RunKeys("*").config
        wait_until(
            lambda: sorted(ask(actor, runs)) == [b"ale-robot/*/config", b"the hub's"],
            "both runs are found",
        )
        # Twice at once would be too often.
        wait_until(
            lambda: ask(actor, KEYS.config) == [b"the hub's"], "it alone answers for its run"
        )
        for key in (KEYS.insert("a"), KEYS.latest_weights, KEYS.job("a"), OTHER.job("a")):
            assert ask(actor, key, b"", 0.2) == []
        for key in (KEYS.sample, KEYS.held_out, KEYS.progress):
            assert ask(learner, key, b"", 0.2) == []


def test_a_replay_at_the_hub_of_another_run_hears_its_own_weights_and_makes_none(
    address: str, shared: Path, other_replay: Transport
) -> None:
    told, heard = SimpleQueue[str](), SimpleQueue[bytes]()
    other_replay.subscribe("ale-robot/*/weights", lambda message: told.put(message.key))
    for keys in (KEYS, OTHER):
        other_replay.subscribe(keys.weights, lambda message: told.put(message.key))
    with (
        connect(address, PATIENCE, role="learner", certificates=shared) as learner,
        connect(address, PATIENCE, certificates=shared) as actor,
    ):
        for keys in (KEYS, OTHER):
            actor.subscribe(keys.weights, lambda message: heard.put(message.payload))
        forged = other_replay.publisher(OTHER.weights)
        publishers = [learner.publisher(keys.weights) for keys in (KEYS, OTHER)]

        def tell() -> bool:
            forged.publish(b"forged")
            for publisher in publishers:
                publisher.publish(b"")
            return not told.empty() and heard.qsize() >= 8  # time enough for the forged ones

        wait_until(tell, "the learner is heard")
    assert {told.get() for _ in range(told.qsize())} == {OTHER.weights}
    assert {heard.get() for _ in range(heard.qsize())} == {b""}


def test_a_replay_is_there_again_after_the_hub_of_another_run_has_started_anew(
    address: str, shared: Path
) -> None:
    hub = open_hub(address, shared)
    with connect(address, PATIENCE, role="replay", name="other", certificates=shared) as replay:
        replay.serve(OTHER.config, lambda _: b"the other's")
        hub.close()
        with (
            open_hub(address, shared),
            connect(address, PATIENCE, certificates=shared) as actor,
        ):
            wait_until(lambda: ask(actor, OTHER.config) == [b"the other's"], "it is found again")


def test_a_replay_whose_run_is_not_on_the_list_is_not_heard(address: str, shared: Path) -> None:
    (shared / "runs.txt").unlink()
    with (
        open_hub(address, shared) as hub,
        connect(address, PATIENCE, role="replay", name="other", certificates=shared) as replay,
        connect(address, PATIENCE, certificates=shared) as actor,
    ):
        hub.serve(KEYS.config, lambda _: b"the hub's")
        replay.serve(OTHER.config, lambda _: b"the other's")
        assert ask(replay, KEYS.config, b"", 0.2) == []
        assert ask(actor, RunKeys("*").config) == [b"the hub's"]


def test_a_replay_without_a_certificate_of_its_run_is_told_how_to_make_one(shared: Path) -> None:
    with pytest.raises(InputError, match=r"no .*replay.third.pem: make .*certificates.sh .* third"):
        check_certificates("tls/127.0.0.1:7447", shared, "replay", "third")


def test_a_hub_lists_no_replay_of_its_own_run(address: str, shared: Path) -> None:
    with pytest.raises(InputError, match=r"runs.txt lists other, the hub's own run, .* delete the"):
        open_hub(address, shared, run="other")
    open_hub(address, shared, run="r").close()


def test_the_script_lists_runs_as_it_lists_actors(shared: Path) -> None:
    certify(shared, "--runs", "other", "third")
    assert (shared / "runs.txt").read_text() == "other\nthird\n"
    assert not (shared / "actors.txt").exists()
    wrong: list[str | Path] = [SCRIPT, shared, "--runs", "a" * 58]
    ended = subprocess.run(wrong, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.startswith("error: no run can be called")


# ---------------------------------------------------------------------- who is let in


def test_strangers_are_not_let_in(
    hub: Transport, address: str, certificates: Path, tmp_path: Path
) -> None:
    # Without any certificate, with one of another authority, and if that one trusts ours.
    with pytest.raises(InputError, match=NOT_LET_IN):
        connect(address.replace("tls/", "tcp/"), 0.0)
    other = certify(tmp_path / "other")
    with pytest.raises(InputError, match=r"certificates or ours are of another authority"):
        connect(address, 0.0, certificates=other)
    shutil.copy(certificates / "ca.pem", other)
    with pytest.raises(InputError, match=NOT_LET_IN):
        connect(address, 0.0, certificates=other)
    connect(address, PATIENCE, certificates=certificates).close()


def not_trusted(address: str, hubs: Path, actors: Path) -> None:
    """An actor turns away from a hub with these certificates at this address."""
    hub = open_hub(address, hubs)
    try:
        with pytest.raises(InputError, match=NOT_LET_IN):
            connect(address, 0.0, certificates=actors)
    finally:
        hub.close()


def test_a_hub_under_another_name_is_not_trusted(address: str, certificates: Path) -> None:
    not_trusted(address.replace("127.0.0.1", "127.0.0.2"), certificates, certificates)


def test_an_actor_cannot_be_a_hub(address: str, certificates: Path, tmp_path: Path) -> None:
    stolen = shutil.copytree(certificates, tmp_path / "stolen")
    for end in (".pem", "-key.pem"):
        shutil.copy(certificates / f"actor{end}", stolen / f"hub{end}")
    not_trusted(address, stolen, certificates)


# ---------------------------------------------------------------------- folders of certificates


def test_addresses_and_certificates_have_to_fit(certificates: Path, tmp_path: Path) -> None:
    assert check_certificates("tcp/127.0.0.1:7447", None, "actor") is None
    for endpoint, folder, words in (
        ("tls/127.0.0.1:7447", None, "needs --certificates"),
        ("tcp/127.0.0.1:7447", certificates, "write tcp/127.0.0.1:7447 as tls/127.0.0.1:7447"),
        ("tls/127.0.0.1:7447", tmp_path, "there is no .*ca.pem: make"),
        ("tls/127.0.0.1", certificates, "is not an address"),
    ):
        with pytest.raises(InputError, match=words):
            check_certificates(endpoint, folder, "actor")


@pytest.mark.parametrize(
    ("file", "other"),
    [("ca.pem", "ca-key.pem"), ("hub.pem", "hub-key.pem"), ("hub.pem", "actor.pem")],
)
def test_files_that_cannot_be_used_are_told(
    certificates: Path, tmp_path: Path, file: str, other: str
) -> None:
    folder = shutil.copytree(certificates, tmp_path / "certificates")
    shutil.copy(certificates / other, folder / file)
    with pytest.raises(InputError, match=r"cannot be used .*make new ones"):
        check_certificates("tls/127.0.0.1:7447", folder, "hub")


CHECK = """
import fcntl, sys, termios
from pathlib import Path
from common.process.program_end import exit_on_input_error
from common.transport.credentials import check_certificates
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
exit_on_input_error(lambda: check_certificates("tls/h:1", Path(sys.argv[1]), "actor"))
"""


def test_nobody_is_asked_at_the_terminal_for_the_password_of_a_key(
    certificates: Path, tmp_path: Path
) -> None:
    folder = shutil.copytree(certificates, tmp_path / "certificates")
    key = folder / "actor-key.pem"
    lock = ["openssl", "ec", "-in", str(certificates / key.name), "-out", str(key), "-aes256"]
    subprocess.run([*lock, "-passout", "pass:secret"], check=True, capture_output=True)
    terminal, own = pty.openpty()
    os.write(terminal, b"\n")  # an answer, without which whoever asks would wait
    asked = subprocess.Popen(
        [sys.executable, "-c", CHECK, folder],
        cwd=ROOT,
        stdin=own,
        stdout=own,
        stderr=own,
        start_new_session=True,
    )
    assert asked.wait(PATIENCE) == BAD_INPUT
    said = os.read(terminal, 4_096).decode()
    os.close(own)
    os.close(terminal)
    assert "cannot be used" in said
    assert "pass phrase" not in said


def test_a_certificate_by_name_that_is_missing_is_named(certificates: Path, tmp_path: Path) -> None:
    folder = tmp_path / "certificates"
    folder.mkdir()
    shutil.copy(certificates / "ca.pem", folder)
    for end in (".pem", "-key.pem"):
        shutil.copy(certificates / f"actor{end}", folder / f"actor.a{end}")
    with pytest.raises(InputError, match=r"no .*actor\.b\.pem: make .* --actors b, and give"):
        check_certificates("tls/127.0.0.1:7447", folder, "actor", "b")
    assert check_certificates("tls/127.0.0.1:7447", folder, "actor", "a") is not None


def test_a_certificate_that_is_out_of_date_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = certify(tmp_path / "certificates")
    check_certificates("tls/127.0.0.1:7447", folder, "actor")
    assert not caplog.messages
    (folder / "actor.pem").write_bytes(expired(folder / "actor.pem", folder / "ca-key.pem"))
    check_certificates("tls/127.0.0.1:7447", folder, "actor")
    (told,) = caplog.messages
    assert told.startswith(f"{folder}/actor.pem expired at 2")


@pytest.mark.parametrize("days", ["0", "-1", "a year", "07", "3651", "999999999"])
def test_the_script_refuses_days_that_are_none_or_more_than_the_authority_has(
    days: str, tmp_path: Path
) -> None:
    made = subprocess.run(
        [SCRIPT, tmp_path / "certificates", "hub"],
        check=False,
        capture_output=True,
        text=True,
        env={**os.environ, "DAYS": days},
    )
    assert made.returncode == 2
    assert f"error: DAYS is '{days}': give the number of days" in made.stderr
    assert not (tmp_path / "certificates").exists()


def test_the_script_names_hosts_and_keeps_the_authority(tmp_path: Path) -> None:
    folder = certify(
        tmp_path / "certificates", "hub.example.org", "192.0.2.7", "2001:db8::7", "beef"
    )
    authority = (folder / "ca.pem").read_bytes()
    actor = (folder / "actor.pem").read_bytes()
    said = subprocess.run(
        ["openssl", "x509", "-in", folder / "hub.pem", "-noout", "-ext", "subjectAltName"],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert said.split("\n")[1].split(", ") == [
        "    DNS:localhost",
        "IP Address:127.0.0.1",
        "IP Address:0:0:0:0:0:0:0:1",
        "DNS:hub.example.org",
        "IP Address:192.0.2.7",
        "IP Address:2001:DB8:0:0:0:0:0:7",
        "DNS:beef",
    ]
    assert {path.stat().st_mode & 0o077 for path in folder.iterdir()} == {0}
    certify(folder)
    assert (folder / "ca.pem").read_bytes() == authority
    assert (folder / "actor.pem").read_bytes() != actor
    assert sorted(path.name for path in folder.iterdir()) == [
        *("actor-key.pem", "actor.pem", "ca-key.pem", "ca.pem", "hub-key.pem", "hub.pem"),
        *("learner-key.pem", "learner.pem"),
    ]


def test_the_script_tells_how_it_is_used(tmp_path: Path) -> None:
    ended = subprocess.run([SCRIPT, tmp_path / "x"], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.startswith("usage: ")
    assert not (tmp_path / "x").exists()


HUB = """
import sys
from pathlib import Path
from common.transport.zenoh_sessions import open_hub
with open_hub(sys.argv[1], Path(sys.argv[2])):
    print("it listens", flush=True)
    sys.stdin.read()
"""


def test_a_hub_prints_who_is_denied_what_when_it_is_asked_to(address: str, named: Path) -> None:
    told = {"RUST_LOG": "zenoh::net::routing::interceptor::access_control=trace"}
    with subprocess.Popen(
        [sys.executable, "-c", HUB, address, str(named)],
        cwd=ROOT,
        env=os.environ | told,
        text=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as hub:
        assert hub.stdout is not None
        while "it listens" not in next(hub.stdout):
            pass
        with connect(address, PATIENCE, name="left", certificates=named) as actor:
            assert ask(actor, KEYS.sample) == []
        output, _ = hub.communicate()
    assert re.search(
        rf"CertCommonName\(actor\.left\).* is unauthorized to Query \(ingress\) on {KEYS.sample}\n",
        output,
    )

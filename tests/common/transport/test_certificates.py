"""Hubs and clients with certificates of `deploy/certificates.sh`, over real connections."""

import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import pytest
import zenoh

from common.errors import InputError
from common.protocol.run_keys import RunKeys
from common.transport.bus import check_certificates, connect, open_hub
from common.transport.credentials import Role
from tests.paths import ROOT
from tests.patience import PATIENCE, wait_until

SCRIPT = ROOT / "deploy" / "certificates.sh"
KEYS = RunKeys("r")
NOT_LET_IN = r"^no hub answered at t"


def make(folder: Path, *hosts: str) -> Path:
    subprocess.run([SCRIPT, folder, *(hosts or ("hub.example.org",))], check=True)
    return folder


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make(tmp_path_factory.mktemp("certificates"))


@pytest.fixture
def address(endpoint: str) -> str:
    return endpoint.replace("tcp/", "tls/")


@pytest.fixture
def hub(address: str, certificates: Path) -> Iterator[zenoh.Session]:
    session = open_hub(address, certificates)
    yield session
    session.close()  # type: ignore[no-untyped-call]


@pytest.fixture
def join(
    hub: zenoh.Session, address: str, certificates: Path
) -> Iterator[Callable[[Role], zenoh.Session]]:
    """Clients of the hub."""
    sessions: list[zenoh.Session] = []

    def one(role: Role) -> zenoh.Session:
        sessions.append(connect(address, PATIENCE, role=role, certificates=certificates))
        return sessions[-1]

    yield one
    for session in sessions:
        session.close()  # type: ignore[no-untyped-call]


def ask(session: zenoh.Session, key: str) -> list[bytes]:
    return [reply.ok.payload.to_bytes() for reply in session.get(key, timeout=PATIENCE) if reply.ok]


QUERIES = {
    "config": KEYS.config,
    "insert": KEYS.insert("a"),
    "latest_weights": KEYS.latest_weights,
    "task": KEYS.task,
    "report": KEYS.report,
    "sample": KEYS.sample,
    "priorities": KEYS.priorities,
    "held_out": KEYS.held_out,
    "progress": KEYS.progress,
}


@pytest.mark.parametrize(
    ("role", "allowed"),
    [
        ("actor", {"config", "insert", "latest_weights", "task", "report"}),
        ("learner", {"config", "sample", "priorities", "held_out", "progress"}),
    ],
)
def test_each_role_is_answered_what_it_may_ask(
    hub: zenoh.Session, join: Callable[[Role], zenoh.Session], role: Role, allowed: set[str]
) -> None:
    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, b"ok")

    hub.declare_queryable(KEYS.all, answer)
    session = join(role)
    assert {name for name, key in QUERIES.items() if ask(session, key) == [b"ok"]} == allowed
    # Whoever asks for all at once gets nothing either.
    assert ask(session, KEYS.all) == []


@pytest.mark.parametrize(
    ("role", "denied", "allowed"),
    [
        ("actor", KEYS.weights, KEYS.stats("actor", "a")),
        ("actor", KEYS.stats("learner", "a"), KEYS.stats("evaluator", "e")),
        ("learner", KEYS.stats("actor", "a"), KEYS.weights),
    ],
)
def test_each_role_tells_what_it_may_tell(
    hub: zenoh.Session,
    join: Callable[[Role], zenoh.Session],
    role: Role,
    denied: str,
    allowed: str,
) -> None:
    heard = hub.declare_subscriber(KEYS.all, zenoh.handlers.FifoChannel(9))
    session = join(role)
    session.put(denied, b"")
    session.put(allowed, b"")
    assert str(_first(heard).key_expr) == allowed  # they come in the order in which they are sent


def _first(heard: "zenoh.Subscriber[Any]") -> zenoh.Sample:
    return cast(zenoh.Sample, wait_until(heard.try_recv, "something is heard"))


def test_an_actor_lives_as_an_actor_alone(
    hub: zenoh.Session, join: Callable[[Role], zenoh.Session]
) -> None:
    heard = hub.liveliness().declare_subscriber(KEYS.live("*", "*"), zenoh.handlers.FifoChannel(9))
    session = join("actor")
    tokens = [
        session.liveliness().declare_token(KEYS.live(role, "a"))
        for role in ("learner", "evaluator")
    ]
    assert str(_first(heard).key_expr) == KEYS.live("evaluator", "a")
    del tokens


def test_an_actor_hears_weights_and_not_others(
    hub: zenoh.Session, join: Callable[[Role], zenoh.Session]
) -> None:
    session = join("actor")
    heard = [
        session.declare_subscriber(key, zenoh.handlers.FifoChannel(999))
        for key in (KEYS.stats("*", "*"), KEYS.weights)
    ]

    def hear_weights() -> zenoh.Sample | None:
        hub.put(KEYS.stats("actor", "other"), b"")
        hub.put(KEYS.weights, b"")
        return heard[1].try_recv()

    assert str(wait_until(hear_weights, "weights are heard").key_expr) == KEYS.weights
    assert heard[0].try_recv() is None


def test_an_actor_cannot_answer_for_the_hub(
    hub: zenoh.Session, join: Callable[[Role], zenoh.Session]
) -> None:
    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, b"truly the hub's")

    rogue = join("actor")
    rogue.declare_queryable(KEYS.config, lambda query: query.reply(query.key_expr, b"forged"))
    hub.declare_queryable(KEYS.latest_weights, answer)
    assert ask(rogue, KEYS.latest_weights) == [b"truly the hub's"]  # so all before has arrived
    assert ask(join("actor"), KEYS.config) == []


def test_a_learner_is_heard_by_name(
    hub: zenoh.Session, join: Callable[[Role], zenoh.Session]
) -> None:
    """Evaluators ask the learner for tasks, through the hub."""
    learner, actor = join("learner"), join("actor")

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, b"task")

    learner.declare_queryable(KEYS.task, answer)
    wait_until(lambda: ask(actor, KEYS.task) == [b"task"], "the actor has its task")


# ---------------------------------------------------------------------- who is let in


def test_strangers_are_not_let_in(
    hub: zenoh.Session, address: str, certificates: Path, tmp_path: Path
) -> None:
    # Without any certificate, with one of another authority, and if that one trusts ours.
    with pytest.raises(InputError, match=NOT_LET_IN):
        connect(address.replace("tls/", "tcp/"), 0.0)
    other = make(tmp_path / "other")
    with pytest.raises(InputError, match=r"certificates or ours are of another authority"):
        connect(address, 0.0, certificates=other)
    shutil.copy(certificates / "ca.pem", other)
    with pytest.raises(InputError, match=NOT_LET_IN):
        connect(address, 0.0, certificates=other)
    connect(address, PATIENCE, certificates=certificates).close()  # type: ignore[no-untyped-call]


def not_trusted(address: str, hubs: Path, actors: Path) -> None:
    """An actor turns away from a hub with these certificates at this address."""
    hub = open_hub(address, hubs)
    try:
        with pytest.raises(InputError, match=NOT_LET_IN):
            connect(address, 0.0, certificates=actors)
    finally:
        hub.close()  # type: ignore[no-untyped-call]


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
        ("tls/127.0.0.1", certificates, "is no address"),
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
    with pytest.raises(InputError, match=r"cannot be used .*make them anew"):
        check_certificates("tls/127.0.0.1:7447", folder, "hub")


def test_the_script_names_hosts_and_keeps_the_authority(tmp_path: Path) -> None:
    folder = make(tmp_path / "certificates", "hub.example.org", "192.0.2.7", "2001:db8::7", "beef")
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
    make(folder)
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

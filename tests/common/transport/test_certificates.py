"""Hubs and clients with certificates of `deploy/certificates.sh`, over real connections."""

import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import SimpleQueue

import pytest

from common.errors import InputError
from common.protocol.live_view import MAX_VIEW_BYTES
from common.protocol.run_keys import RunKeys
from common.transport.credentials import Role, check_certificates
from common.transport.interface import Envelope, Transport
from common.transport.zenoh_transport import connect, open_hub
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
    "task": KEYS.task,
    "report": KEYS.report,
    "sample": KEYS.sample,
    "priorities": KEYS.priorities,
    "held_out": KEYS.held_out,
    "progress": KEYS.progress,
    "status": KEYS.status,
    "view": KEYS.view("actor", "a"),
}


@pytest.mark.parametrize(
    ("role", "allowed"),
    [
        ("actor", {"config", "insert", "latest_weights", "task", "report"}),
        ("learner", {"config", "sample", "priorities", "held_out", "progress", "status", "view"}),
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
    heard: SimpleQueue[Envelope] = SimpleQueue()
    hub.subscribe(KEYS.all, heard.put)
    transport = join(role)
    for key in (denied, allowed):
        transport.publisher(key).publish(b"")
    # They come in the order in which they are sent.
    assert heard.get(timeout=PATIENCE).key == allowed


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
    learner, actor = join("learner"), join("actor")
    for name, length in (("a", MAX_VIEW_BYTES), ("b", 2 * MAX_VIEW_BYTES + 1)):
        actor.serve(KEYS.view("actor", name), lambda request, n=length: request.payload + bytes(n))
    wait_until(
        lambda: ask(learner, KEYS.view("actor", "a"), b"?") == [b"?" + bytes(MAX_VIEW_BYTES)],
        "the view has come",
    )
    assert ask(learner, KEYS.view("actor", "b"), b"?", 0.2) == []


def test_a_learner_is_heard_by_name(hub: Transport, join: Callable[[Role], Transport]) -> None:
    """Evaluators ask the learner for tasks, through the hub."""
    learner, actor = join("learner"), join("actor")

    learner.serve(KEYS.task, lambda _: b"task")
    wait_until(lambda: ask(actor, KEYS.task) == [b"task"], "the actor has its task")


# ---------------------------------------------------------------------- who is let in


def test_strangers_are_not_let_in(
    hub: Transport, address: str, certificates: Path, tmp_path: Path
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

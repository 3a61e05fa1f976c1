"""Certificates that a launcher makes: kept while they last, and what is told if none can be."""

import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from common.errors import InputError
from deploy.certificates import certify_actors, ensure_certificates, make_certificates
from tests.certificates import SCRIPT


def test_certificates_that_end_soon_are_made_anew_and_who_was_shut_out_stays_out(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("DAYS", "29")
    ensure_certificates(tmp_path, "learner")
    certify_actors(tmp_path, "learner", ["a", "b"])
    (tmp_path / "actors.txt").write_text("a\n")
    before = {path.name: path.read_bytes() for path in tmp_path.glob("*.pem")}
    for days, renewed in (("31", True), ("365", False)):
        monkeypatch.setenv("DAYS", days)
        ensure_certificates(tmp_path, "learner")
        certify_actors(tmp_path, "learner", ["a", "b"])
        now = {path.name: path.read_bytes() for path in tmp_path.glob("*.pem")}
        changed = {name for name in now if now[name] != before[name]}
        same = {"ca.pem", "ca-key.pem", "actor.b.pem", "actor.b-key.pem"}
        assert changed == (now.keys() - same if renewed else set())
        assert (tmp_path / "actors.txt").read_text() == "a\n"
        before = now


def test_a_hubs_certificate_without_names_is_made_anew(tmp_path: Path) -> None:
    """As of a program that writes the host as the common name alone."""
    make_certificates(tmp_path, "localhost")
    nameless = tmp_path / "hub.pem"
    words = f"openssl req -x509 -subj /CN=localhost -days 99 -key {tmp_path}/hub-key.pem"
    subprocess.run([*words.split(), "-out", str(nameless)], check=True)
    before = nameless.read_bytes()
    ensure_certificates(tmp_path, "localhost")
    assert nameless.read_bytes() != before


@pytest.mark.parametrize("asked", [("localhost",), ("--actors", "robot-2"), ("--runs", "other")])
def test_a_machine_without_the_authoritys_key_makes_no_authority(
    tmp_path: Path, asked: tuple[str, ...]
) -> None:
    """As that of an actor, whose ca.pem another would take from it."""
    make_certificates(tmp_path, "localhost")
    (tmp_path / "ca-key.pem").unlink()
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(InputError, match=r"has ca\.pem without ca-key\.pem: make certificates in"):
        make_certificates(tmp_path, *asked)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_certificates_that_cannot_be_made_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"no certificates can be made \(.*exists\): fix that\.$"):
        certify_actors(tmp_path / "file", "localhost", ["actor-1"])
    for program in ("sh", "mkdir", "mktemp", "rm", "rmdir", "tail"):
        (tmp_path / program).symlink_to(str(shutil.which(program)))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match=r"can be made \(.*openssl.*\): install openssl\.$"):
        certify_actors(tmp_path / "new", "localhost", ["actor-1"])
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ("certs --actor robot-1", "error: there is no option --actor: use it as above."),
        ("--certs host", "error: there is no option --certs: use it as above."),
        ("--actors host", "usage:"),
        ("certs host --runs", "error: no host can be called '--runs': give a name"),
        ("certs 'bad host'", "error: no host can be called 'bad host': give a name"),
        ("certs a,DNS:evil", "error: no host can be called 'a,DNS:evil': give a name"),
        ("certs host:7447", "error: no host can be called 'host:7447': give a name, without"),
        ("certs .host", "error: no host can be called '.host': give a name"),
        ("certs ''", "error: no host can be called '': give a name"),
        ("certs 999.1.1.1", r"error: openssl failed \(.*=.*999.1.1.1.*\): fix that"),
    ],
)
def test_what_is_no_host_makes_nothing(tmp_path: Path, asked: str, told: str) -> None:
    made = _script(tmp_path, asked)
    assert made.returncode == (1 if "openssl" in told else 2)
    assert re.match(told, _last(made.stderr))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("asked", ["--help", "certs -h", "certs --actors --help"])
def test_the_script_says_how_it_is_used(tmp_path: Path, asked: str) -> None:
    made = _script(tmp_path, asked)
    assert (made.returncode, made.stderr) == (0, "")
    assert made.stdout.startswith("usage: ")
    assert made.stdout.count("as in: ") == 3
    assert not list(tmp_path.iterdir())


def test_what_fails_midway_leaves_the_certificates_as_they_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where the disk is full, or a host is no IP address."""
    make_certificates(tmp_path / "certs", "localhost")
    before = {path.name: path.read_bytes() for path in (tmp_path / "certs").iterdir()}
    count, openssl = tmp_path / "count", tmp_path / "bin" / "openssl"
    openssl.parent.mkdir()
    openssl.write_text(
        f"#!/bin/sh\necho >>{count}; [ $(wc -l <{count}) -lt 5 ] || exit 1\n"
        f'exec {shutil.which("openssl")} "$@"\n'
    )
    openssl.chmod(0o700)
    monkeypatch.setenv("PATH", f"{openssl.parent}:{os.environ['PATH']}")
    for asked in ("certs localhost", "certs --actors a b c"):
        count.unlink(missing_ok=True)
        assert _last(_script(tmp_path, asked).stderr).startswith("error: openssl failed")
        assert {path.name: path.read_bytes() for path in (tmp_path / "certs").iterdir()} == before


def _script(place: Path, asked: str) -> subprocess.CompletedProcess[str]:
    words = [str(SCRIPT), *shlex.split(asked)]
    return subprocess.run(words, cwd=place, capture_output=True, text=True)


def _last(said: str) -> str:
    return said.splitlines()[-1] if "error" in said else said

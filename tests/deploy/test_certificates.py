"""Certificates that a launcher makes: kept while they last, and what is told if none can be."""

import shutil
from pathlib import Path

import pytest

from common.errors import InputError
from deploy.certificates import certify_actors, ensure_certificates, make_certificates


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
    for program in ("sh", "mkdir", "mktemp", "rm", "cat"):
        (tmp_path / program).symlink_to(str(shutil.which(program)))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match=r"can be made \(.*openssl.*\): install openssl\.$"):
        certify_actors(tmp_path / "new", "localhost", ["actor-1"])

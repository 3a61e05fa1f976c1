"""Weights that the learner signed, and all others, by certificates of `deploy/certificates.sh`."""

import datetime
import random
import shutil
import subprocess
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from common.errors import InputError, MessageError
from common.transport.credentials import Credentials
from common.transport.signature import Check, Sign, Signature, checker, signer
from tests.certificates import certify

TOLD = ("training", 7, "run-1", b"weights")


@pytest.fixture(scope="module")
def sign(certificates: Path) -> Sign:
    return signer(certificates)


@pytest.fixture(scope="module")
def check(certificates: Path) -> Check:
    return checker(Credentials.find(certificates, "actor"))


def test_what_the_learner_signed_is_taken(sign: Sign, check: Check) -> None:
    check(*TOLD, sign(*TOLD))


@pytest.mark.parametrize(
    "other",
    [
        ("test", 7, "run-1", b"weights"),
        ("training", 8, "run-1", b"weights"),
        ("training", 7, "run-2", b"weights"),
        ("training", 7, "run-1", b"weightS"),
        ("training", 7, "run-1", b""),
    ],
)
def test_it_is_for_this_purpose_version_run_and_bytes_alone(
    sign: Sign, check: Check, other: tuple[str, int, str, bytes]
) -> None:
    with pytest.raises(MessageError, match="their signature does not fit"):
        check(*other, sign(*TOLD))


def test_a_certificate_may_be_renewed_while_the_learner_works(
    certificates: Path, tmp_path: Path
) -> None:
    own, renewed = shutil.copytree(certificates, tmp_path / "own"), certify(tmp_path / "renewed")
    sign = signer(own)
    shutil.copy(renewed / "learner.pem", own)  # and not yet its key
    former = checker(Credentials.find(certificates, "actor"))
    former(*TOLD, sign(*TOLD))
    shutil.copy(renewed / "learner-key.pem", own)
    checker(Credentials.find(renewed, "actor"))(*TOLD, sign(*TOLD))
    with pytest.raises(MessageError, match="not of our authority"):
        former(*TOLD, sign(*TOLD))


def test_nothing_has_to_be_signed_where_nobody_has_a_certificate() -> None:
    assert signer(None)(*TOLD) == b""
    checker(None)(*TOLD, b"")


def test_what_is_not_signed_is_not_taken(check: Check) -> None:
    with pytest.raises(MessageError, match="they are not signed"):
        check(*TOLD, b"")


@pytest.mark.parametrize("role", ["hub", "actor"])
def test_no_other_role_signs(certificates: Path, check: Check, tmp_path: Path, role: str) -> None:
    """Nor does a hub that was taken over, whose own certificate is of the same authority."""
    stolen = shutil.copytree(certificates, tmp_path / "stolen")
    for end in (".pem", "-key.pem"):
        shutil.copy(certificates / f"{role}{end}", stolen / f"learner{end}")
    with pytest.raises(MessageError, match="certificate is not that of a learner"):
        check(*TOLD, signer(stolen)(*TOLD))


def test_who_shows_the_learners_certificate_has_not_its_key(
    certificates: Path, sign: Sign, check: Check, tmp_path: Path
) -> None:
    stolen = shutil.copytree(certificates, tmp_path / "stolen")
    for end in (".pem", "-key.pem"):
        shutil.copy(certificates / f"hub{end}", stolen / f"learner{end}")
    shown = Signature.decode(sign(*TOLD)).certificate
    forged = Signature.decode(signer(stolen)(*TOLD)).signature
    with pytest.raises(MessageError, match="their signature does not fit"):
        check(*TOLD, Signature(shown, forged).encode())


def test_an_authority_of_the_same_name_is_another(check: Check, tmp_path: Path) -> None:
    with pytest.raises(MessageError, match="certificate is not of our authority"):
        check(*TOLD, signer(certify(tmp_path))(*TOLD))


@pytest.mark.parametrize("began", [-30, 30])
def test_a_certificate_has_its_time(
    certificates: Path, check: Check, tmp_path: Path, began: int
) -> None:
    """Days from now at which it begins, for ten days."""
    folder = shutil.copytree(certificates, tmp_path / "old")
    authority = x509.load_pem_x509_certificate((folder / "ca.pem").read_bytes())
    signs = serialization.load_pem_private_key((folder / "ca-key.pem").read_bytes(), None)
    learner = x509.load_pem_x509_certificate((folder / "learner.pem").read_bytes())
    begin = datetime.datetime.now(datetime.UTC) + datetime.timedelta(days=began)
    assert isinstance(signs, ec.EllipticCurvePrivateKey)
    old = (
        x509.CertificateBuilder(authority.subject, learner.subject, learner.public_key())
        .serial_number(1)
        .not_valid_before(begin)
        .not_valid_after(begin + datetime.timedelta(days=10))
        .sign(signs, hashes.SHA256())
    )
    (folder / "learner.pem").write_bytes(old.public_bytes(serialization.Encoding.PEM))
    with pytest.raises(MessageError, match="certificate is out of date"):
        check(*TOLD, signer(folder)(*TOLD))


def test_whatever_else_comes_is_refused(sign: Sign, check: Check) -> None:
    dice, good = random.Random(0), sign(*TOLD)
    told = Signature.decode(good)
    junk = [Signature(b"", b""), Signature(told.certificate, b""), Signature(b"", told.signature)]
    spoiled = [each.encode() for each in junk]
    for _ in range(500):
        part = bytearray(told.certificate)
        part[dice.randrange(len(part))] ^= 1 << dice.randrange(8)
        spoiled.append(Signature(bytes(part), told.signature).encode())
        whole = bytearray(good)
        whole[dice.randrange(len(whole))] ^= 1 << dice.randrange(8)
        spoiled.append(bytes(whole))
    for each in spoiled:
        with pytest.raises(MessageError):
            check(*TOLD, each)


def test_a_learner_without_its_certificate_is_told(certificates: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(certificates, tmp_path / "hub's")
    (folder / "learner.pem").unlink()
    with pytest.raises(InputError, match=r"there is no .*learner.pem: make .* give this machine"):
        signer(folder)


def test_a_key_of_another_kind_is_told(certificates: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(certificates, tmp_path / "rsa")
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=learner"),
            *("-keyout", folder / "learner-key.pem", "-out", folder / "learner.pem"),
        ],
        check=True,
        capture_output=True,
    )
    with pytest.raises(InputError, match=r"learner-key.pem is not an elliptic-curve key: make"):
        signer(folder)

"""What the faults are made of does what it says: disks, clocks and certificates."""

import ssl
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks.chaos import disk as disk_module
from benchmarks.chaos.certificates import Certificates
from benchmarks.chaos.clock import Clocks
from benchmarks.chaos.disk import Disk


def test_a_disk_is_full_and_read_only_for_a_while_and_its_files_stay(tmp_path: Path) -> None:
    with Disk(tmp_path / "disk", 2**20) as disk:
        if disk.missing is not None:
            pytest.skip(disk.missing)
        (disk.folder / "file").write_bytes(b"before")
        give_back = disk.fill()
        with pytest.raises(OSError, match="No space left"):
            (disk.folder / "more").write_bytes(bytes(4096))
        give_back()
        (disk.folder / "more").write_bytes(bytes(4096))
        remove = disk.crowd()
        (disk.folder / "more").write_bytes(bytes(8192))
        with pytest.raises(OSError, match="No space left"):
            (disk.folder / "another").touch()
        remove()
        allow = disk.forbid()
        with pytest.raises(OSError, match="Read-only"):
            (disk.folder / "more").write_bytes(b"")
        allow()
        (disk.folder / "more").unlink()
    assert [path.name for path in disk.folder.iterdir()] == ["file"]
    assert not disk.folder.is_mount()


def test_a_disk_becomes_read_only_although_somebody_begins_to_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Disk(tmp_path / "disk", 2**20) as disk:
        if disk.missing is not None:
            pytest.skip(disk.missing)
        mount = disk_module._mount
        refusals: list[str] = []

        def beside_a_writer(*arguments: str) -> str | None:
            if "--bind" in arguments or refusals:
                return mount(*arguments)
            with (disk.folder / "file").open("wb"):
                refusals.append(f"{mount(*arguments)}")
                return refusals[0]

        monkeypatch.setattr(disk_module, "_mount", beside_a_writer)
        allow = disk.forbid()
        assert "busy" in refusals[0]
        with pytest.raises(OSError, match="Read-only"):
            (disk.folder / "file").write_bytes(b"")
        allow()
        (disk.folder / "file").write_bytes(b"")


def test_a_disk_that_an_error_left_read_only_goes_too(tmp_path: Path) -> None:
    with Disk(tmp_path / "disk", 2**20) as disk:
        if disk.missing is not None:
            pytest.skip(disk.missing)
        disk.forbid()
    assert not disk.folder.is_mount()
    assert [path.name for path in tmp_path.iterdir()] == ["disk"]


def test_a_clock_jumps_for_one_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clocks = Clocks(tmp_path)
    if clocks.missing is not None:
        pytest.skip(clocks.missing)
    (tmp_path / "tell.py").write_text("import time; print(time.time() - time.monotonic())")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")

    def ahead() -> float:
        command = [sys.executable, "-m", *clocks.command("a"), "tell"]
        told = float(subprocess.run(command, capture_output=True, check=True).stdout)
        return told - (time.time() - time.monotonic())

    assert abs(ahead()) < 1
    clocks.set("a", -86_400)
    assert abs(ahead() + 86_400) < 1
    clocks.set("a", 0)
    assert abs(ahead()) < 1


def test_a_certificate_expires_and_is_renewed(tmp_path: Path) -> None:
    certificates = Certificates(tmp_path, {"actor-1": "actor"})
    assert certificates.missing is None
    folder = certificates.of("actor-1")

    def is_good() -> bool:
        command = ["openssl", "x509", "-checkend", "0", "-noout", "-in", str(folder / "actor.pem")]
        ssl.create_default_context().load_cert_chain(
            folder / "actor.pem", folder / "actor-key.pem"
        )  # they fit each other
        return subprocess.run(command, capture_output=True).returncode == 0

    assert is_good()
    certificates.expire("actor-1")
    assert not is_good()
    certificates.renew("actor-1")
    assert is_good()
    assert sorted(path.name for path in folder.iterdir()) == [
        *("actor-key.pem", "actor.pem", "ca.pem")
    ]

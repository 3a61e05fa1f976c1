"""`Certificates`: the certificates of a run's processes, which can be made to expire."""

import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from benchmarks.child import refusal
from common.process.supervisor import ROOT
from common.transport.credentials import Role


class Certificates:
    """Folders of certificates in ``folder``, one for each process, under one authority.

    Args:
        roles: roles of the processes by name.
    """

    def __init__(self, folder: Path, roles: Mapping[str, Role]) -> None:
        self._folder = folder
        self._roles = roles
        self._valid, self._expired = folder / "valid", folder / "expired"
        self.missing = self._make(self._valid)
        """Reason why there are no certificates; None if there are."""
        if self.missing is None:
            shutil.copytree(self._valid, self._expired)
            self.missing = self._make(self._expired, DAYS="-1")
            for name in roles:
                self.of(name).mkdir()
                shutil.copy(self._valid / "ca.pem", self.of(name))
                self.renew(name)

    def _make(self, folder: Path, **environment: str) -> str | None:
        script = ROOT / "deploy/certificates.sh"
        return refusal(script, folder, "localhost", env={**os.environ, **environment})

    def of(self, name: str) -> Path:
        """Returns the folder of a process."""
        return self._folder / name

    def expire(self, name: str) -> None:
        """Replaces a process's certificate by one that was valid until yesterday."""
        self._put(self._expired, name)

    def renew(self, name: str) -> None:
        """Replaces a process's certificate by a valid one."""
        self._put(self._valid, name)

    def _put(self, source: Path, name: str) -> None:
        role = self._roles[name]
        for file in (f"{role}.pem", f"{role}-key.pem"):
            shutil.copy(source / file, self.of(name))

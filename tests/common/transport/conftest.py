"""Certificates of `deploy/certificates.sh`, and an address where they are asked for."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.paths import ROOT

SCRIPT = ROOT / "deploy" / "certificates.sh"


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
def named(certificates: Path, tmp_path: Path) -> Path:
    """A folder of a hub that knows two actors by name."""
    folder = shutil.copytree(certificates, tmp_path / "named")
    subprocess.run([SCRIPT, folder, "--actors", "left", "right"], check=True)
    return folder

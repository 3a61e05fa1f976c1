"""Addresses where certificates are asked for, and folders with those of some names."""

import shutil
from pathlib import Path

import pytest

from tests.certificates import certify


@pytest.fixture
def address(endpoint: str) -> str:
    return endpoint.replace("tcp/", "tls/")


@pytest.fixture(scope="session")
def _named(certificates: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = shutil.copytree(certificates, tmp_path_factory.mktemp("named") / "all")
    return certify(folder, "--actors", "left", "right")


@pytest.fixture
def named(_named: Path, tmp_path: Path) -> Path:
    """A folder of a hub that knows two actors by name."""
    return shutil.copytree(_named, tmp_path / "named")

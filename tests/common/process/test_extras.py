"""Packages that only some flags need."""

import tomllib

import pytest
from packaging.requirements import Requirement

from common.errors import InputError
from common.process.extras import PACKAGES, extra_for
from tests.paths import ROOT

IMPORTED = {"mlflow-skinny": "mlflow", "rerun-sdk": "rerun"}
"""Packages that are imported by another name than pip's."""


def test_what_is_looked_for_is_what_pip_installs() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    for extra, looked_for in PACKAGES.items():
        installed = [Requirement(each).name for each in extras[extra]]
        assert list(looked_for) == [IMPORTED.get(n, n.replace("-", "_")) for n in installed]


def test_a_missing_package_is_told_with_its_extra() -> None:
    with (
        pytest.raises(InputError, match=r"--http needs the package no_such_package, .*\[ops\]'"),
        extra_for("--http", "ops"),
    ):
        import no_such_package  # type: ignore[import-not-found]  # noqa: F401

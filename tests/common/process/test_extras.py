"""Packages that only some flags need."""

import pytest

from common.errors import InputError
from common.process.extras import extra_for


def test_a_missing_package_is_told_with_its_extra() -> None:
    with (
        pytest.raises(InputError, match=r"--http needs the package no_such_package, .*\[ops\]'"),
        extra_for("--http", "ops"),
    ):
        import no_such_package  # type: ignore[import-not-found]  # noqa: F401

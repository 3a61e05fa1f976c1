"""Packages that only some flags need (extras of `pyproject.toml`)."""

from collections.abc import Iterator
from contextlib import contextmanager

from common.errors import InputError


@contextmanager
def extra_for(flag: str, extra: str) -> Iterator[None]:
    """Says how to install what an import needs.

    Raises:
        InputError: a package of ``extra`` is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(
            f"{flag} needs the package {error.name}, which is not installed: "
            f"pip install 'ale-robot[{extra}]'."
        ) from None

"""Checks of arguments in Python, whose errors name the argument."""

from typing import Any

from common.checked import Invalid, build
from common.errors import InputError


def check_argument(kind: Any, value: object, name: str) -> None:
    """Raises InputError if ``value`` is not of its declared ``kind``, such as `Fraction`."""
    try:
        build(kind, value, name)
    except Invalid as error:
        raise InputError(f"{error}.") from None


def check_settings(kind: type, value: object, name: str) -> None:
    """Raises InputError if ``value`` is no ``kind``, a group of settings."""
    if not isinstance(value, kind):
        raise InputError(f"{name} is {value!r}: give a {kind.__name__}.")

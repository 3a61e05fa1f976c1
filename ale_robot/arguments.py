"""Checks of arguments in Python, whose errors name the argument."""

from typing import Any, TypeVar

import numpy as np

from common.errors import InputError
from common.settings.stored_config import from_mapping

T = TypeVar("T")


def check_argument(kind: type[T], value: Any, name: str) -> T:
    """Returns ``value``, a number of NumPy's as one of Python's. Raises InputError if it is not of
    its declared ``kind``, such as `Fraction`."""
    return from_mapping(kind, value.item() if isinstance(value, np.generic) else value, name)


def check_settings(kind: type, value: object, name: str) -> None:
    """Raises InputError if ``value`` is no ``kind``, a group of settings."""
    if not isinstance(value, kind):
        raise InputError(f"{name} is {value!r}: give a {kind.__name__}.")

"""How long tests wait for what should happen."""

import time
from collections.abc import Callable
from typing import Any

import pytest

PATIENCE = 600.0
"""Seconds after which something that does not happen is a failure; many times a whole small run."""


def wait_until(condition: Callable[[], Any], what: str) -> Any:
    """The condition's first true value; fails when it never comes."""
    deadline, pause = time.monotonic() + PATIENCE, 0.001
    while not (value := condition()):
        if time.monotonic() > deadline:
            pytest.fail(f"waited {PATIENCE:.0f} s in vain until {what}")
        time.sleep(pause)
        pause = min(1.2 * pause, 0.05)  # who waits for long need not look often
    return value

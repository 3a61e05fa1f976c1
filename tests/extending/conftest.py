"""Real processes for what is registered from outside."""

from tests.end_to_end.conftest import stage

__all__ = ["stage"]

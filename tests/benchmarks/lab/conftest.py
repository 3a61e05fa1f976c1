"""Real processes for an experiment that trains."""

from tests.end_to_end.conftest import stage

__all__ = ["stage"]

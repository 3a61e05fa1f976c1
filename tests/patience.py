"""How long tests wait for what should happen."""

PATIENCE = 600.0
"""Seconds after which something that does not happen is a failure; many times a whole small run."""

"""Launches a run on an engine that the user already has: one description, one module per engine."""

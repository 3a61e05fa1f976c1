"""Optics of NAO's camera as published, shared by the simulated camera and the screen detector."""

WIDTH_ANGLE = 60.97
HEIGHT_ANGLE = 47.64
"""Horizontal and vertical field of view, degrees."""

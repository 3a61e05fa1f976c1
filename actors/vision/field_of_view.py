"""NAO's field of view as published, for the simulated camera and the screen detector."""

WIDTH_ANGLE = 60.97
HEIGHT_ANGLE = 47.64
"""Horizontal and vertical field of view, degrees."""

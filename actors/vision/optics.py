"""NAO's camera as its maker describes it, which the eye knows as any owner of a camera would."""

WIDTH_ANGLE = 60.97
HEIGHT_ANGLE = 47.64
"""Field of view in degrees."""

"""Health checks of `--check`: figures that tell whether this robot sees and touches at all.

The learner has health checks of a whole run (`learner.telemetry.health_checks`); these need no
learner.
"""

from dataclasses import dataclass

LEAST_VALID_FRAMES = 0.99
LEAST_CORNERS_FOUND = 0.99
MOST_CORNER_ERROR = 1.5
"""Pixels of the camera by which a corner may be off."""
LEAST_PIXEL_DEVIATION = 1.0
LEAST_KEYS_MATCHED = 0.5


@dataclass(frozen=True)
class Check:
    """One measured figure against its bound."""

    name: str
    value: float
    least: float
    meaning: str
    """What is wrong when it is red."""

    @property
    def green(self) -> bool:
        """It is good enough; NaN is not."""
        return self.value >= self.least


def judge(
    *,
    pixel_deviation: float,
    valid_share: float | None,
    corners_share: float | None,
    match_share: float | None,
) -> list[Check]:
    """Returns the health checks of these figures.

    Args:
        pixel_deviation: mean of the frames' standard deviations, grey levels of 255.
        valid_share: of the frames, those in which the detector says that it found the screen.
        corners_share: of the frames, those in which all corners are where they truly are.
        match_share: of the agent steps, those that ended with the commanded keys pressed. The last
            three are a robot's; None elsewhere.
    """
    checks = [
        Check(
            "pixel deviation",
            pixel_deviation,
            LEAST_PIXEL_DEVIATION,
            "the network's frames are black or of one grey",
        )
    ]
    for name, value, least, meaning in (
        ("valid frames", valid_share, LEAST_VALID_FRAMES, "the screen is not found"),
        (
            f"corners within {MOST_CORNER_ERROR:g} px",
            corners_share,
            LEAST_CORNERS_FOUND,
            "what is found is not the screen",
        ),
        (
            "keys as commanded",
            match_share,
            LEAST_KEYS_MATCHED,
            "the hands do not press what they are told to",
        ),
    ):
        if value is not None:
            checks.append(Check(name, value, least, meaning))
    return checks

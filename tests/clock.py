"""Time that passes when a test says so."""


class Clock:
    """A clock, in seconds, that stands still until it is set on."""

    def __init__(self, now: float = 0.0) -> None:
        self.now = now

    def __call__(self) -> float:
        return self.now

"""From what a terminal sends to the keys that a person holds down.

A terminal tells of keys that go down, and again and again while they stay down, but never of one
that is let go. So a key counts as held until its next repeat is overdue.
"""

import re

from common.actions import Keys

HOLD = 0.15
"""Seconds after its last repeat that a key still counts as held."""

_SENT: dict[bytes, Keys] = {
    b"A": Keys.UP,
    b"B": Keys.DOWN,
    b"C": Keys.RIGHT,
    b"D": Keys.LEFT,
}
_OPPOSITE = {
    Keys.UP: Keys.DOWN,
    Keys.DOWN: Keys.UP,
    Keys.LEFT: Keys.RIGHT,
    Keys.RIGHT: Keys.LEFT,
}
# An arrow key, with modifiers or without, in the cursor keys' two modes; any other sequence; or
# a single character.
_TOKEN = re.compile(rb"\x1b[\[O][0-9;]*([ABCD])|\x1b[\[O][0-9;]*[ -~]|[\x00-\xff]", re.DOTALL)
_ESCAPE = b"\x1b"
_UNFINISHED = re.compile(rb"\x1b([\[O][0-9;]*)?\Z")


class HeldKeys:
    """Arrow keys and space as controller keys; q or Escape to leave."""

    def __init__(self) -> None:
        self._until: dict[Keys, float] = {}
        self._rest = b""
        self.wants_out = False
        """q, Escape or Ctrl-D was pressed."""

    def feed(self, sent: bytes, now: float) -> None:
        """Take what the terminal sent at ``now`` (monotonic seconds), or that it sent nothing."""
        if not sent and self._rest == _ESCAPE:
            self.wants_out = True  # nothing followed: it was the key itself
        sent, self._rest = self._rest + sent if sent else b"", b""
        if cut := _UNFINISHED.search(sent):
            sent, self._rest = sent[: cut.start()], cut[0]
        for match in _TOKEN.finditer(sent):
            token, arrow = match[0], match[1]
            if arrow is not None:
                self._press(_SENT[arrow], now)
            elif token == b" ":
                self._press(Keys.FIRE, now)
            elif token in (b"q", b"Q", b"\x04"):
                self.wants_out = True

    def held(self, now: float) -> Keys:
        """The keys that count as held at ``now``."""
        held = Keys.NONE
        for key, until in self._until.items():
            if now < until:
                held |= key
        return held

    def _press(self, key: Keys, now: float) -> None:
        self._until[key] = now + HOLD
        # The other end of the stick's axis was let go, or the stick could not be here.
        if key in _OPPOSITE:
            self._until.pop(_OPPOSITE[key], None)

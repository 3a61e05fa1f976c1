"""Finds out which keys a person holds down, from what the terminal sends.

Most terminals report keys that go down, and repeat them while they stay down, but do not report
releases. So a key counts as held until its next repeat is overdue. Some terminals report releases
of arrow keys on request (kitty's keyboard protocol; `Terminal` requests it). There an arrow is held
until its release, or until another window gets the keyboard, because a terminal repeats only the
key that went down last.
"""

import re

from common.actions import OPPOSITES, Keys

HOLD = 0.15
"""Seconds for which a key counts as held after its last repeat."""
LONGEST_HOLD = 10.0
"""The same for an arrow if the terminal reports releases, in case it misses one."""

_SENT: dict[bytes, Keys] = {
    b"A": Keys.UP,
    b"B": Keys.DOWN,
    b"C": Keys.RIGHT,
    b"D": Keys.LEFT,
}
_OPPOSITE = {key: pair & ~key for pair in OPPOSITES for key in pair}
# A token is one of: an arrow key, in the two modes of cursor keys, with or without modifiers, and
# its event; the answer whether releases of arrow keys are reported; any other sequence or answer; a
# single character.
_TOKEN = re.compile(
    rb"\x1b[\[O][0-9;]*(?P<event>:[0-9])?(?P<arrow>[ABCD])"
    rb"|\x1b\[\?(?P<flags>[0-9]+)u"
    rb"|\x1b[\[O][?0-9;:]*[@-~]"
    rb"|\x1b_G[^\x1b]{0,99}\x1b\\"
    rb"|[\x00-\xff]",
    re.DOTALL,
)
_REPEATED, _LET_GO = b":2", b":3"
_TELLS = 2
_ESCAPE = b"\x1b"
_FOCUS_LOST = b"\x1b[O"
_UNFINISHED = re.compile(rb"\x1b([\[O][?0-9;:]*|_G[^\x1b]{0,99}\x1b?)?\Z")


class HeldKeys:
    """Turns arrow keys and space into controller keys; q and Escape leave."""

    def __init__(self) -> None:
        self._until: dict[Keys, float] = {}
        self._unread = Keys.NONE
        """Keys that went down since `held` was last called."""
        self._tapped = Keys.NONE
        """Those of `_unread` that were released since."""
        self._rest = b""
        self._arrow_hold = HOLD
        self.wants_out = False
        """Whether q, Escape or Ctrl-D was pressed."""

    def feed(self, sent: bytes, now: float) -> None:
        """Takes what the terminal sent at ``now`` (monotonic seconds); empty if it sent nothing."""
        if not sent and self._rest == _ESCAPE:
            self.wants_out = True  # nothing followed, so it was the Escape key itself
        sent, self._rest = self._rest + sent if sent else b"", b""
        if cut := _UNFINISHED.search(sent):
            sent, self._rest = sent[: cut.start()], cut[0]
        for match in _TOKEN.finditer(sent):
            token = match[0]
            if match["arrow"] and match["event"] == _LET_GO:
                key = _SENT[match["arrow"]]
                self._until.pop(key, None)
                self._tapped |= key & self._unread
            elif match["arrow"]:
                if match["event"] != _REPEATED:
                    self._unread |= _SENT[match["arrow"]]
                self._press(_SENT[match["arrow"]], now + self._arrow_hold)
            elif match["flags"] and int(match["flags"]) & _TELLS:
                self._arrow_hold = LONGEST_HOLD
            elif token == _FOCUS_LOST:
                self._until.clear()
            elif token == b" ":
                self._press(Keys.FIRE, now + HOLD)
            elif token in (b"q", b"Q", b"\x04"):
                self.wants_out = True

    def held(self, now: float) -> Keys:
        """Returns the keys that count as held at ``now``, and those tapped since the last call, so
        that no tap is lost however rarely it is called."""
        held, self._tapped, self._unread = self._tapped, Keys.NONE, Keys.NONE
        for key, until in self._until.items():
            if now < until:
                held |= key
        return held

    def _press(self, key: Keys, until: float) -> None:
        self._until[key] = until
        # A stick cannot be at both ends of an axis, so the opposite key must have been released.
        if key in _OPPOSITE:
            self._until.pop(_OPPOSITE[key], None)
            self._tapped &= ~_OPPOSITE[key]

"""From what a terminal sends to the keys that a person holds down.

Most terminals tell of keys that go down, and again and again while they stay down, but never of
one that is let go. So a key counts as held until its next repeat is overdue. Some, asked to, tell
when an arrow key is let go (kitty's keyboard protocol, `Terminal` asks for it).
"""

import re

from common.actions import OPPOSITES, Keys

HOLD = 0.15
"""Seconds after its last repeat that a key still counts as held."""
LONGEST_HOLD = 1.0
"""The same where the terminal tells of keys let go, in case it looked elsewhere when they were."""

_SENT: dict[bytes, Keys] = {
    b"A": Keys.UP,
    b"B": Keys.DOWN,
    b"C": Keys.RIGHT,
    b"D": Keys.LEFT,
}
_OPPOSITE = {key: pair & ~key for pair in OPPOSITES for key in pair}
# An arrow key, with modifiers or without, in the cursor keys' two modes, and what became of it; the
# answer whether arrow keys that are let go are told of; any other sequence or answer; or a single
# character.
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
_UNFINISHED = re.compile(rb"\x1b([\[O][?0-9;:]*|_G[^\x1b]{0,99}\x1b?)?\Z")


class HeldKeys:
    """Arrow keys and space as controller keys; q or Escape to leave."""

    def __init__(self) -> None:
        self._until: dict[Keys, float] = {}
        self._unread = Keys.NONE
        """Keys that went down since `held` was last called."""
        self._tapped = Keys.NONE
        """Those of them that were let go since."""
        self._rest = b""
        self._arrow_hold = HOLD
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
            elif token == b" ":
                self._press(Keys.FIRE, now + HOLD)
            elif token in (b"q", b"Q", b"\x04"):
                self.wants_out = True

    def held(self, now: float) -> Keys:
        """The keys that count as held at ``now``, and those that were tapped since the last call:
        however rarely it is called, no tap is lost."""
        held, self._tapped, self._unread = self._tapped, Keys.NONE, Keys.NONE
        for key, until in self._until.items():
            if now < until:
                held |= key
        return held

    def _press(self, key: Keys, until: float) -> None:
        self._until[key] = until
        # The other end of the stick's axis was let go, or the stick could not be here.
        if key in _OPPOSITE:
            self._until.pop(_OPPOSITE[key], None)
            self._tapped &= ~_OPPOSITE[key]

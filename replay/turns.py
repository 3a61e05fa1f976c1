"""`Turns`: decides whose chunks are accepted while the rate limiter throttles all actors.

A throttled actor may have a window of chunks under way, and should send no more. One that keeps
sending would fill the room that the learner makes before the waiting actors hear of it. So each
actor has an account of the steps by which it is ahead. Its chunks add to the account, and each time
the limiter opens, all accounts fall by a turn, the steps of one chunk. While the limiter is closed,
an actor that is a window ahead is refused, and an actor that is not ahead has its turn. So in the
long run, all actors that want to send get the same number of steps. This is start-time fair
queueing (Goyal et al. 1996), by steps.

The next chunk of an actor that was told to go on is always accepted, even if others have closed the
limiter before it comes. An actor with many environments sends several chunks at once, so some may
be refused; it sends them again.
"""

from collections import Counter

from common.transport.access_control import MAX_SESSIONS

INSISTENCE = 20
"""Number of refusals in a row that only an actor that ignores the throttle reaches."""
MAX_ACTORS = MAX_SESSIONS
"""Maximum number of accounts; beyond it, the account that was charged longest ago is dropped."""


class Turns:
    """Accounts of actors, by name; the caller must hold a lock.

    Args:
        turn: number of steps that each actor may send whenever the limiter opens.
        window: maximum number of turns that an actor may be ahead.
    """

    def __init__(self, turn: int, window: int) -> None:
        self._turn = turn
        self._most = turn * window
        self._now = 0
        """Steps by which accounts have fallen so far."""
        self._paid_until: dict[str, int] = {}
        """By actor, the ``_now`` at which it is no longer ahead."""
        self._asked: set[str] = set()
        """Actors that asked to send since the limiter last opened."""
        self._let_go: set[str] = set()
        """Actors that were told to go on, and have not yet sent a chunk."""
        self._refused: Counter[str] = Counter()
        """Number of refusals of each actor since its last accepted chunk."""

    def open(self) -> None:
        """Lets all accounts fall, at least until one actor that asked has its turn."""
        least = min((self._paid_until[actor] for actor in self._asked), default=0)
        self._now = max(self._now + self._turn, least)
        self._asked.clear()

    def has_turn(self, actor: str) -> bool:
        """Whether ``actor`` may go on although the limiter is closed. A new actor must wait."""
        return self._account(actor, self._now + self._turn) <= self._now

    def admits(self, actor: str) -> bool:
        """Whether a chunk of ``actor`` is accepted although the limiter is closed."""
        ahead = self._account(actor, self._now) - self._now
        admitted = ahead < self._most or actor in self._let_go
        self._refused[actor] += not admitted
        return admitted

    def let_go(self, actor: str) -> None:
        """Notes that ``actor`` was told to go on."""
        self._paid_until.setdefault(actor, self._now)
        self._let_go.add(actor)
        self._forget()

    def ignores_throttle(self, actor: str) -> bool:
        """Whether ``actor`` keeps sending although it is refused."""
        return self._refused[actor] >= INSISTENCE

    def charge(self, actor: str, steps: int, *, still_open: bool) -> None:
        """Notes that ``steps`` of ``actor`` were accepted.

        Args:
            still_open: whether the limiter still has room. If so, no account goes beyond the
                window; otherwise the actor that used the room best would wait longest.
        """
        paid = max(self._paid_until.pop(actor, self._now), self._now)
        until = paid + steps
        if still_open:
            until = max(min(until, self._now + self._most), paid)
        self._paid_until[actor] = until
        self._let_go.discard(actor)
        del self._refused[actor]
        self._forget()

    def _account(self, actor: str, new: int) -> int:
        paid = self._paid_until.setdefault(actor, new)
        self._asked.add(actor)
        self._forget()
        return paid

    def _forget(self) -> None:
        if len(self._paid_until) > MAX_ACTORS:
            oldest = next(iter(self._paid_until))
            del self._paid_until[oldest], self._refused[oldest]
            self._asked.discard(oldest)
            self._let_go.discard(oldest)

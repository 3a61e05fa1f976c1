"""`Absence`: how an actor waits for a process that went away, and when it gives up."""

import math
from dataclasses import dataclass

from actors.member import Member
from common.errors import Unreachable

_TELL_AFTER = 10.0
"""Seconds of an absence before people are told."""


@dataclass
class Absence:
    """Tells people that the ``other`` process, such as the hub, is away, and that it is back.

    ``role`` is what this process is, for the message.
    """

    member: Member
    other: str
    role: str
    _told: bool = False

    def lasts(self, seconds: float) -> None:
        """Notes that the other process has been away for this long.

        Raises:
            Unreachable: it has been away for longer than the patience.
        """
        if seconds > self.member.patience:
            raise Unreachable(
                f"the {self.other} went away and did not come back in "
                f"{self.member.patience:.0f} s: "
                f"start it again with --resume, then start this {self.role}."
            )
        if seconds > _TELL_AFTER and not self._told:
            self._told = True
            patience = self.member.patience
            most = f" up to {patience:.0f} s" if math.isfinite(patience) else ""
            self.member.warn(f"the {self.other} does not answer: waiting{most} for it.")

    def ends(self) -> None:
        """Notes that the other process answers."""
        if self._told:
            self._told = False
            self.member.warn(f"the {self.other} answers again.")

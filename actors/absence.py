"""`Absence`: an actor waits for who is away, and for how long."""

from dataclasses import dataclass

from actors.member import Member
from common.errors import Unreachable

_TELL_AFTER = 10.0
"""Seconds of an absence after which people are told."""


@dataclass
class Absence:
    """What is said of the ``other``, such as the hub, while this ``role`` waits for it."""

    member: Member
    other: str
    role: str
    _told: bool = False

    def lasts(self, seconds: float) -> None:
        """Take note that there has been nobody for so long.

        Raises:
            Unreachable: that is longer than the patience.
        """
        if seconds > self.member.patience:
            raise Unreachable(
                f"the {self.other} went away and did not come back in "
                f"{self.member.patience:.0f} s: "
                f"start it again with --resume, then start this {self.role}."
            )
        if seconds > _TELL_AFTER and not self._told:
            self._told = True
            self.member.warn(f"the {self.other} does not answer: waiting for it.")

    def ends(self) -> None:
        """Take note of an answer."""
        if self._told:
            self._told = False
            self.member.warn(f"the {self.other} answers again.")

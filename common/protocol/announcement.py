"""How a hub tells those who join which run it serves, and under which configuration."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from common.checked import Name
from common.errors import InputError
from common.protocol.message import Message
from common.run.config import RunConfig


@dataclass(frozen=True)
class Announcement(Message):
    """A run, its configuration and identity, and the number of actions that its replay admits."""

    run: Name
    config: RunConfig
    actions: Annotated[int, Ge(1), Le(256)]
    run_id: str
    """Identity of the run: a UUID from its beginning, and a hash of its configuration.

    Chunks, acknowledgements, weights and jobs carry it, so that nobody who joined one run takes
    part in another that was begun under its name at its address.
    """

    def check(self) -> None:
        """See `Message.check`. Raises InputError for settings that cannot work here, or an
        environment that has another number of actions."""
        self.config.check()
        if self.actions != self.config.action_count:
            raise InputError(
                f"{self.config.game} ({self.config.env}) has {self.actions} actions at the hub and "
                f"{self.config.action_count} here: install the same versions on both machines."
            )

"""`Announcement`: tells processes that join a hub which run it serves, and its configuration."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from common.checked import Name
from common.errors import InputError
from common.protocol.message import Message
from common.run.rules import check_config
from common.settings.config import RunConfig


@dataclass(frozen=True)
class Announcement(Message):
    """A run, its configuration and identity, and the number of actions that its replay accepts."""

    run: Name
    config: RunConfig
    actions: Annotated[int, Ge(1), Le(256)]
    run_id: str
    """Identity of the run: a UUID from its beginning, and a hash of its configuration.

    Chunks, acknowledgements, weights and jobs carry it. So a process that joined one run never
    takes part in another that was begun under the same name at the same address.
    """

    def check(self) -> None:
        """See `Message.check`. Raises InputError for settings that cannot work here, or if the
        environment has a different number of actions here."""
        # The learner and the replay draw, and check theirs.
        check_config(self.config.without_sampler)
        if self.actions != self.config.action_count:
            raise InputError(
                f"{self.config.played} has {self.actions} actions at the hub and "
                f"{self.config.action_count} here: install the same versions on both machines."
            )

"""`Member`: what an actor process knows of the run that it joined, for all of its parts."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from common.errors import Unreachable
from common.process.log_lines import say_aside
from common.protocol.run_keys import RunKeys
from common.settings.config import RunConfig
from common.transport.interface import Transport
from common.transport.signature import Check, unchecked


@dataclass(frozen=True)
class Member:
    """One process of a run."""

    name: str
    transport: Transport
    keys: RunKeys
    config: RunConfig
    patience: float
    """Seconds to wait for a hub or learner that went away."""
    stop: threading.Event
    """Set from outside to make the process leave, and from inside when the run is finished."""
    incarnation: int = field(default_factory=time.time_ns)
    """Number of this start of the process; it is larger at each start."""
    tell: Callable[[str], None] = say_aside
    check_weights: Check = unchecked
    """Checks that weights come from the run's learner."""

    def check_run(self, run_id: str) -> None:
        """Refuses to take part in any run but the one that was joined.

        Raises:
            InputError: ``run_id``, taken from a message, belongs to another run.
        """
        if run_id != self.keys.run_id:
            raise Unreachable(
                f"the hub now serves a different run under the name {self.keys.run}, and refuses "
                f"{self.name}, which joined the former one: start this process again to join it."
            )

    def warn(self, sentence: str) -> None:
        """Tells people what happened."""
        self.tell(f"{self.name}: {sentence}")

"""What an actor process knows of the run that it joined, for all of its parts."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from common.errors import Unreachable
from common.process.log_lines import say_aside
from common.protocol.run_keys import RunKeys
from common.run.config import RunConfig
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
    """Differs for each start of the process, and grows."""
    tell: Callable[[str], None] = say_aside
    check_weights: Check = unchecked
    """Tells whether weights are the learner's own."""

    def check_run(self, run_id: str) -> None:
        """Refuse to take part in another run than the one that was joined.

        Raises:
            InputError: ``run_id``, which somebody told, is another one's.
        """
        if run_id != self.keys.run_id:
            raise Unreachable(
                f"the hub serves another run as {self.keys.run} now than {self.name} joined, and "
                "refuses what is not of it: start this process again to join that run."
            )

    def warn(self, sentence: str) -> None:
        """Tell people what happened."""
        self.tell(f"{self.name}: {sentence}")

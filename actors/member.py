"""What an actor process knows of the run that it joined, for all of its parts."""

import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from common.protocol.run_keys import RunKeys
from common.run.config import RunConfig
from common.transport.interface import Transport


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
    tell: Callable[[str], None] = lambda text: print(text, file=sys.stderr, flush=True)

    def warn(self, sentence: str) -> None:
        """Tell people what happened."""
        self.tell(f"{self.name}: {sentence}")

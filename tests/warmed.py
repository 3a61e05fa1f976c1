"""What each program does before it begins, done once before any is forked."""

from actors import actor
from common.command_line.run_options import parse_run
from common.network import LAYERS
from common.process import lifeline, supervisor
from learner.options import LearnerOptions
from tests.patience import PATIENCE
from tests.tiny_network import TINY

# Flags and their help are read from source code, and each setting's check is built.
parse_run(LearnerOptions, "learner", [], lambda _: None)
# A busy machine may take its time over an actor's last chunk.
actor.FAREWELL = lifeline.GRACE = supervisor.GRACE = PATIENCE  # type: ignore[attr-defined]
LAYERS["nips"] = TINY

"""The keys of the learner's tests."""

from common.protocol.run_keys import RunKeys

KEYS = RunKeys("r")

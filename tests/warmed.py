"""What each program does before it begins, done once before any is forked."""

from common.process.command_line import parse_run
from learner.options import LearnerOptions

# Flags and their help are read from source code, and each setting's check is built.
parse_run(LearnerOptions, "learner", [], lambda _: None)

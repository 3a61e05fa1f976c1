"""The page for operators tells every flag that a run is operated by."""

import dataclasses
import re

import pytest

from common.exit_codes import EXIT_CODES
from learner.options import LearnerOptions
from replay.__main__ import ReplayOptions
from tests.paths import ROOT

GROUPS = {"config", "clock", "evaluation"}
"""Fields whose flags are the run's, the actors' and an evaluation's, and are told in docs/."""


@pytest.mark.parametrize("options", [LearnerOptions, ReplayOptions])
def test_every_flag_of_operation_is_told(options: type[LearnerOptions | ReplayOptions]) -> None:
    page = (ROOT / "deploy" / "README.md").read_text()
    told = set(re.findall(r"`(--[a-z-]+)[ `]", page))
    flags = {f"--{each.name.replace('_', '-')}" for each in dataclasses.fields(options)}
    assert flags - told == {f"--{group}" for group in GROUPS} & flags


def test_the_exit_codes_are_told() -> None:
    page = (ROOT / "docs" / "operations.md").read_text()
    told = re.findall(r"(?m)^\| (\d+) \| (.+) \| (yes|no) \|$", page)
    declared = [(str(n), meaning, "yes" if again else "no") for n, meaning, again in EXIT_CODES]
    assert told == declared

"""Processes that a benchmark starts: helpers that answer, and modules that fail."""

import pytest

from benchmarks.child import Helper, run_module
from benchmarks.hosted_run import HostedRun
from common.errors import InputError


def test_a_helper_that_ends_is_told_by_its_name() -> None:
    def ask_on(helper: Helper) -> None:
        while True:
            helper.say("more")
            helper.hear()

    with Helper("the third", "json.tool", "--help") as helper:
        assert helper.hear().startswith("usage")
        with pytest.raises(InputError, match="the third failed"):
            ask_on(helper)


def test_a_module_that_fails_is_told() -> None:
    with pytest.raises(InputError, match="ended with exit code 2"):
        run_module("json.tool", "--none")


def test_a_run_that_cannot_be_hosted_says_why() -> None:
    with (
        pytest.raises(InputError, match=r"the replay ended, and said: .*capacity"),
        HostedRun("replay", "--replay.capacity", "1"),
    ):
        pass

"""Lines for people as they are, or as JSON with time, level, role and figures."""

import json
import math
import subprocess
import sys

from common.process.log_lines import line
from tests.paths import ROOT

CODE = """
import logging, math, sys
from common.errors import InputError, exit_on_input_error
from common.process.log_lines import line, say_json
say_json("replay")
print(line("ε is\\n1", values={"a/b": 1, "c/d": math.nan, "e/f": None}), file=sys.stderr)
logging.getLogger("x").warning("%d chunks", 3)
def fail():
    raise InputError("there is none: make one.")
exit_on_input_error(fail)
"""


def test_lines_are_as_they_are_by_default() -> None:
    assert line("ε is 1", "warning", {"a/b": math.inf}) == "ε is 1"


def test_lines_logs_and_errors_as_json() -> None:
    done = subprocess.run(
        [sys.executable, "-c", CODE], cwd=ROOT, capture_output=True, text=True, check=False
    )
    told = [json.loads(each) for each in done.stderr.splitlines()]
    assert done.returncode == 2
    assert [(each["level"], each["message"]) for each in told] == [
        ("info", "ε is\n1"),
        ("warning", "3 chunks"),
        ("error", "error: there is none: make one."),
    ]
    assert told[0]["values"] == {"a/b": 1, "c/d": None, "e/f": None}
    assert {each["role"] for each in told} == {"replay"}
    assert all(each["time"].endswith("Z") and len(each["time"]) == 24 for each in told)

"""`python -m benchmarks.lab.fuzz --json FILE`: fuzzes every kind of message.

`tests.fuzz` passes changed messages to each part that decodes input from outside, guided by the
lines that they reach (Atheris: `pip install -e '.[fuzz]'`). A message that is neither accepted nor
refused, or that takes ten seconds or 2 GiB of memory, is reported with the file that holds it. The
same command continues with the kinds that are missing from FILE.
"""

import re
import subprocess
import sys
from dataclasses import dataclass
from functools import partial
from typing import Any

from benchmarks.report import BenchmarkOptions, Report, main, measure_missing, resumed
from common.checked import FromOne
from common.errors import InputError, choice
from common.process.extras import extra_for
from common.process.supervisor import ROOT


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Pass changed messages of each kind to the program, and count what they reach."""

    messages: FromOne = 100_000
    """Number of messages of each kind."""
    seed: FromOne = 1
    """Seed of the changes."""
    kinds: tuple[str, ...] = ()
    """Kinds of message; by default all."""


def measure(options: Options) -> Report:
    with extra_for("fuzzing", "fuzz"):
        import atheris  # noqa: F401
    about = {"title": "changed messages", "messages": options.messages, "seed": options.seed}
    found = resumed(options.json, about, "fuzzing with these flags")
    known = _run().stdout.split()
    if unknown := sorted({*options.kinds} - {*known}):
        raise InputError(f"there is no kind {unknown[0]}: {choice(unknown[0], known)}")
    asked = [{"kind": kind} for kind in options.kinds or known]
    rows = measure_missing(options.json, found, "rows", asked, partial(_fuzz, options))
    return Report.of(found["title"], rows, about)


def _fuzz(options: Options, kind: str) -> dict[str, Any]:
    """Returns the figures of a kind; ``kept`` is the number of messages that reached new edges.

    Raises:
        InputError: a message did harm.
    """
    said = _run(kind, "--messages", f"{options.messages}", "--seed", f"{options.seed}").stderr
    last = re.findall(r"^#\d+\s+DONE\s+cov: (\d+) .*? corp: (\d+)/", said, re.MULTILINE)
    numbers = dict(re.findall(r"^stat::(\w+):\s+(\d+)$", said, re.MULTILINE))
    if not last:
        raise InputError(f"the fuzzer of {kind} did not report its end: {said[-400:]}.")
    return {
        "messages": int(numbers["number_of_executed_units"]),
        "edges reached": int(last[0][0]),
        "kept": int(last[0][1]),
        "longest s": int(numbers["slowest_unit_time_sec"]),
        "memory MiB": int(numbers["peak_rss_mb"]),
    }


def _run(*arguments: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "tests.fuzz", *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        raise InputError(f"{' '.join(arguments)} did harm: {done.stderr[-2_000:].strip()}")
    return done


if __name__ == "__main__":
    main("lab.fuzz", Options, measure)

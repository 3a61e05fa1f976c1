"""In a process of its own, for the setting holds as long as the process."""

import ctypes
import os
import subprocess
import sys

import pytest

from common.process.allocator import keep_large_blocks

MEASURE = """
import resource
from common.process.allocator import keep_large_blocks

def faults() -> int:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(50):
        bytearray(b"x") * 4_000_000
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

before = faults()
assert keep_large_blocks()
faults()
print(before, faults())
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="not of glibc")
def test_blocks_are_used_again_without_the_system() -> None:
    # What glibc does by itself depends on what was freed before; so it always gives back.
    giving_back = {**os.environ, "MALLOC_TRIM_THRESHOLD_": "131072"}
    told = subprocess.run(
        [sys.executable, "-c", MEASURE],
        env=giving_back,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    before, after = map(int, told.split())
    assert after < 50 < 5_000 < before


def test_other_c_libraries_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("common.process.allocator.ctypes.CDLL", lambda _: object())
    assert not keep_large_blocks()

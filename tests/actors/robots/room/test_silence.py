"""Output of C code is suppressed inside the block and nowhere else."""

import ctypes
import os

import pytest

from actors.robots.nao.robot import Nao
from actors.robots.room.silence import silenced


def test_only_output_inside_the_block_is_dropped(capfd: pytest.CaptureFixture[str]) -> None:
    libc = ctypes.CDLL(None)
    libc.printf(b"before\n")
    with silenced():
        libc.printf(b"inside, in C's own buffer\n")
        os.write(2, b"inside\n")
    print("after")
    libc.fflush(None)
    out, err = capfd.readouterr()
    assert "before" in out
    assert "after" in out
    assert "inside" not in out + err


def test_descriptors_come_back_after_an_error(capfd: pytest.CaptureFixture[str]) -> None:
    def fail() -> None:
        raise RuntimeError("inside")

    with pytest.raises(RuntimeError), silenced():
        fail()
    os.write(1, b"heard\n")
    assert capfd.readouterr().out == "heard\n"


def test_a_room_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    room = Nao()
    room.step_frame()
    room.close()
    ctypes.CDLL(None).fflush(None)
    assert capfd.readouterr() == ("", "")

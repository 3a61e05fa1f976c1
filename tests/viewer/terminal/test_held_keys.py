"""What a terminal sends, as keys that are held."""

import pytest

from common.actions import Keys
from viewer.terminal.held_keys import HOLD, LONGEST_HOLD, HeldKeys


@pytest.mark.parametrize(
    ("sent", "keys"),
    [
        (b"\x1b[A", Keys.UP),
        (b"\x1bOB", Keys.DOWN),
        (b"\x1b[C", Keys.RIGHT),
        (b"\x1b[1;2D", Keys.LEFT),
        (b" ", Keys.FIRE),
        (b"\x1b[A\x1b[C ", Keys.UP | Keys.RIGHT | Keys.FIRE),
        (b"\x1b[A\x1b[B", Keys.DOWN),
        (b"x\x1b[5~\x1b[H\xff", Keys.NONE),
        (b"\x1b_Gi=31;quite so \x1b\\ ", Keys.FIRE),
    ],
)
def test_what_is_sent_is_held_for_a_while(sent: bytes, keys: Keys) -> None:
    held = HeldKeys()
    held.feed(sent, 10.0)
    assert held.held(10.0) == held.held(10.0 + HOLD * 0.99) == keys
    assert held.held(10.0 + HOLD) == Keys.NONE
    assert not held.wants_out


def test_repeats_keep_a_key_down_and_others_fall_off() -> None:
    held = HeldKeys()
    held.feed(b"\x1b[A ", 0.0)
    held.feed(b" ", 0.1)
    assert held.held(0.2) == Keys.FIRE


@pytest.mark.parametrize(
    ("parts", "keys"),
    [
        ((b"\x1b", b"[", b"1;", b"2A"), Keys.UP),
        # An answer about graphics is no key, and the q in it leaves nothing.
        ((b"\x1b", b"_Gi=31;q", b"uit\x1b", b"\\"), Keys.NONE),
    ],
)
def test_a_sequence_may_come_in_parts(parts: tuple[bytes, ...], keys: Keys) -> None:
    held = HeldKeys()
    for part in parts:
        held.feed(part, 0.0)
    assert held.held(0.0) == keys
    assert not held.wants_out


@pytest.mark.parametrize("sent", [b"q", b"Q", b"\x04"])
def test_letters_that_leave(sent: bytes) -> None:
    held = HeldKeys()
    held.feed(b"\x1b[A" + sent, 0.0)
    assert held.wants_out


def test_escape_leaves_once_nothing_follows() -> None:
    held = HeldKeys()
    held.feed(b"\x1b", 0.0)
    assert not held.wants_out
    held.feed(b"", 0.02)
    assert held.wants_out


def test_where_letting_go_is_told_arrows_are_held_until_then() -> None:
    held = HeldKeys()
    held.feed(b"\x1b[?2u", 0.0)
    held.feed(b"\x1b[A ", 0.0)
    # The first repeat comes late, and is no gap.
    assert held.held(0.4) == Keys.UP
    held.feed(b"\x1b[1;1:2A\x1b[1;1:1C", 0.5)
    held.feed(b"\x1b[1;2:3A", 0.6)
    assert held.held(0.6) == Keys.RIGHT
    # Another key ends the repeats of the one before.
    held.feed(b" ", 0.7)
    assert held.held(9.0) == Keys.RIGHT
    assert held.held(0.5 + LONGEST_HOLD) == Keys.NONE
    held.feed(b"\x1b[1;1:3B", 11.0)
    assert held.held(11.0) == Keys.NONE
    assert not held.wants_out


def test_without_the_keyboard_nothing_is_held() -> None:
    held = HeldKeys()
    held.feed(b"\x1b[?2u\x1b[I\x1b[C ", 0.0)
    assert held.held(0.05) == Keys.RIGHT | Keys.FIRE
    held.feed(b"\x1b[O", 0.05)
    assert held.held(0.06) == Keys.NONE
    held.feed(b"\x1b[I\x1b[OA", 0.1)  # lost once more; then a letter
    assert held.held(0.1) == Keys.NONE


def test_a_tap_between_two_looks_is_seen_once() -> None:
    held = HeldKeys()
    held.feed(b"\x1b[?2u\x1b[A\x1b[1;1:3A", 0.0)
    assert held.held(0.05) == Keys.UP
    assert held.held(0.05) == Keys.NONE
    held.feed(b"\x1b[C\x1b[1;1:3C\x1b[D\x1b[1;1:3D", 0.1)
    assert held.held(0.1) == Keys.LEFT  # the newer end of the axis
    held.feed(b"\x1b[A", 0.2)
    assert held.held(0.2) == Keys.UP
    held.feed(b"\x1b[1;1:3A", 0.25)
    assert held.held(0.25) == Keys.NONE  # it was seen


def test_a_terminal_that_knows_the_question_and_says_no() -> None:
    held = HeldKeys()
    held.feed(b"\x1b[?0u\x1b[A", 0.0)
    assert held.held(HOLD) == Keys.NONE

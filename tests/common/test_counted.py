"""Numbers of things, in words."""

from common.counted import counted


def test_one_thing_has_no_plural() -> None:
    told = [counted(number, "game") for number in (0, 1, 2, 1_234)]
    assert told == ["0 games", "1 game", "2 games", "1,234 games"]

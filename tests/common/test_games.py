"""The table of games against ale-py itself."""

import pytest
from ale_py import roms

from actors.envs.emulator import Emulator
from common.errors import InputError
from common.games import GAMES, MINIMAL_ACTIONS, check_game


def test_all_games_for_one_player_are_listed() -> None:
    assert set(roms.get_all_rom_ids()) - set(GAMES) == {
        "combat",
        "joust",
        "maze_craze",
        "warlords",
    }
    assert len(GAMES) == len(set(GAMES)) == 104


@pytest.mark.parametrize("game", GAMES)
def test_actions_are_those_that_ale_tells_apart(game: str) -> None:
    assert Emulator(game, 0).minimal_actions == MINIMAL_ACTIONS[game]


def test_unknown_games_get_suggestions() -> None:
    assert check_game("space_invaders") == "space_invaders"
    for wrong, right in (("pomg", "pong"), ("Space-Invaders", "space_invaders")):
        with pytest.raises(InputError, match=rf"'{wrong}'.*did you mean .*{right}"):
            check_game(wrong)
    for hopeless in ("", "xyzzy", "../pong"):
        with pytest.raises(InputError, match="there is no game"):
            check_game(hopeless)
    with pytest.raises(InputError, match="no game 'combat'"):  # two players: ALE would exit
        Emulator("combat", 1)

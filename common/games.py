"""The single-player games that ale-py bundles, and the minimal action set of each.

Learner and replay need the number of actions of a run, but load neither emulator nor ROM. The
source is ALE itself (`ALEInterface.getMinimalActionSet`); a test compares this table with it.
Games for two players are left out: ALE cannot play them, and ends the process if it is asked to
load one.
"""

from difflib import get_close_matches

from common.errors import InputError

_GAMES_OF_ACTIONS: dict[tuple[int, ...], str] = {
    tuple(range(18)): (
        "adventure alien bank_heist battle_zone berzerk boxing centipede chopper_command "
        "crossbow darkchambers defender donkey_kong double_dunk earthworld elevator_action "
        "entombed et fishing_derby flag_capture frostbite gravitar hangman haunted_house "
        "hero human_cannonball ice_hockey jamesbond kangaroo klax krull laser_gates "
        "mario_bros miniature_golf montezuma_revenge pitfall pitfall2 private_eye riverraid "
        "road_runner robotank seaquest solaris space_war star_gunner superman tennis "
        "trondead venture video_cube word_zapper yars_revenge zaxxon"
    ),
    (0, 1, 2, 3, 4, 5): "basic_math king_kong qbert",
    (0, 1, 2, 3, 4, 5, 6, 7, 8, 9): "othello tic_tac_toe_3d video_chess",
    (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13): "keystone_kapers",
    (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12): "turmoil",
    (0, 1, 2, 3, 4, 5, 6, 7, 10, 11, 12, 13, 14, 15): "asteroids",
    (0, 1, 2, 3, 4, 5, 10, 11, 12): "video_pinball",
    (0, 1, 2, 3, 4, 5, 10, 11, 12, 13): "amidar mr_do time_pilot wizard_of_wor",
    (0, 1, 2, 3, 4, 6, 7, 11, 12): "beam_rider",
    (0, 1, 2, 3, 4, 10, 11, 12): "gopher",
    (0, 1, 2, 3, 4, 11, 12): "assault",
    (0, 1, 2, 5): "blackjack casino",
    (0, 1, 2, 5, 10, 13): "bowling pooyan up_n_down",
    (0, 1, 3, 4): "breakout kaboom",
    (0, 1, 3, 4, 5): "tetris",
    (0, 1, 3, 4, 5, 8, 9, 11, 12): "enduro",
    (0, 1, 3, 4, 5, 11, 12, 13): "phoenix",
    (0, 1, 3, 4, 11, 12): (
        "air_raid carnival demon_attack galaxian name_this_game pong sir_lancelot space_invaders"
    ),
    (0, 1, 11, 12): "atlantis atlantis2",
    (0, 2, 3, 4, 5): "frogger pacman surround",
    (0, 2, 3, 4, 5, 6, 7, 8, 9): "asterix crazy_climber koolaid lost_luggage ms_pacman",
    (0, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13, 14, 15, 16, 17): "journey_escape",
    (0, 2, 3, 4, 5, 8, 9, 11, 12, 13, 14, 15, 16, 17): "kung_fu_master",
    (0, 2, 3, 4, 5, 10, 11, 12): "tutankham",
    (0, 2, 5): "freeway",
    (0, 3, 4): "skiing",
    (1, 3, 4): "backgammon",
    (1, 6, 7, 8, 9): "video_checkers",
}

MINIMAL_ACTIONS: dict[str, tuple[int, ...]] = {
    game: actions for actions, games in _GAMES_OF_ACTIONS.items() for game in games.split()
}
"""ALE's numbers of the actions that a game distinguishes, by the game's name in snake_case."""

GAMES: tuple[str, ...] = tuple(sorted(MINIMAL_ACTIONS))

SCREEN_SHAPE = (210, 160)
"""Rows and columns of most games' pictures."""


def check_game(game: str) -> str:
    """Returns ``game`` if ale-py bundles it. Raises InputError if it does not, with suggestions of
    similar names."""
    if game not in MINIMAL_ACTIONS:
        alike = get_close_matches(game.lower().replace("-", "_").replace(" ", "_"), GAMES, n=3)
        hint = (
            f"did you mean {' or '.join(alike)}?"
            if alike
            else "choose one, such as space_invaders."
        )
        raise InputError(f"there is no game {game!r} among ale-py's {len(GAMES)}: {hint}")
    return game

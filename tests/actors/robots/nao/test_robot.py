"""The room as an environment uses it: repeatable, isolated from other rooms, viewable."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.robots.nao.controller import KEY_PLACES, PRESS_DEPTH, RELEASE_DEPTH
from actors.robots.nao.robot import Nao
from actors.robots.room import scene
from actors.robots.room import viewpoint as module
from actors.robots.room.camera import Camera, Rendering
from actors.robots.room.viewpoint import _MAX_KEPT, VISITOR
from actors.vision.window import Window
from common.actions import KEYS_OF_ACTION, Keys
from common.protocol.live_view import ViewName

GAME = np.full((210, 160, 3), (200, 40, 90), np.uint8)


def trace(room: Nao, seed: int) -> list[NDArray[np.float64]]:
    """Returns the keys' depths at every frame of random play."""
    rng = np.random.default_rng(seed)
    depths = []
    for action in rng.integers(18, size=20):
        room.command(KEYS_OF_ACTION[action])
        for _ in range(4):
            room.step_frame()
            depths.append(room.controller.depths())
    return depths


def test_reset_leaves_nothing_behind(room: Nao) -> None:
    room.rest()
    first = trace(room, 1)
    trace(room, 2)
    room.rest()
    assert np.array_equal(first, trace(room, 1))


def test_at_a_reset_no_key_is_held_even_before_the_first_frame(room: Nao) -> None:
    room.rest()
    room.command(Keys.FIRE)
    for _ in range(8):
        room.step_frame()
    before = room.held
    room.rest()
    assert (before, room.held) == (Keys.FIRE, Keys.NONE)


def test_two_rooms_are_the_same_and_do_not_touch(room: Nao) -> None:
    other = Nao()
    room.rest()
    first = trace(room, 3)
    assert np.array_equal(first, trace(other, 3))
    room.rest()
    room.command(Keys.FIRE)
    for _ in range(8):
        room.step_frame()
    other.rest()
    assert other.step_frame() == Keys.NONE
    other.close()


def test_at_rest_nothing_is_pressed(room: Nao) -> None:
    room.rest()
    assert {room.step_frame() for _ in range(60)} == {Keys.NONE}
    assert room.controller.depths().max() < RELEASE_DEPTH / 2


def test_camera_picture_shows_the_game(room: Nao) -> None:
    picture = room.picture(GAME)
    assert picture.shape == (240, 320, 3)
    assert picture.dtype == np.uint8
    assert picture[120, 160].tolist() == [200, 40, 90]


def test_view_shows_robot_and_game(room: Nao) -> None:
    room.rest()
    view = room.view(GAME, 320, 240)
    assert view.shape == (240, 320, 3)
    assert (view == (200, 40, 90)).all(axis=2).mean() > 0.03
    bodies = VISITOR.camera(room._engine, 320, 240).render().bodies
    assert (bodies == room.body).mean() > 0.02
    assert (bodies == room.controller.body).any()


def any_green(picture: NDArray[np.uint8]) -> bool:
    """Whether it shows a pressed key."""
    red, green, blue = np.moveaxis(picture.astype(int), 2, 0)
    return bool(((green > red + 60) & (green > blue + 60)).any())


def test_view_shows_a_pressed_key(room: Nao) -> None:
    room.rest()
    before = room.view(GAME, 320, 240)
    room.command(Keys.FIRE)
    for _ in range(8):
        room.step_frame()
    after = room.view(GAME, 320, 240)
    assert any_green(after)
    assert not np.array_equal(before, after)


def test_games_of_another_height() -> None:
    room = Nao((250, 160))
    picture = room.picture(np.full((250, 160, 3), 128, np.uint8))
    assert picture[120, 160].tolist() == [128, 128, 128]
    room.close()
    room.close()


def test_a_view_that_turns_keeps_its_distance_and_is_not_kept_for_ever(room: Nao) -> None:
    turned = VISITOR.turned(90.0)
    away, before = (np.subtract(each.position, each.target) for each in (turned, VISITOR))
    np.testing.assert_allclose(away, (-before[1], before[0], before[2]))
    room.rest()
    seen = [room.view(GAME, 32, 24, turn=float(turn)) for turn in range(20)]
    assert not any(np.array_equal(*each) for each in pairwise(seen))
    views = room._views._views
    assert sum(key == (VISITOR, 32, 24) for key in views) == 1  # those before do not come again
    for width in range(20):
        room.view(GAME, 40 + width, 24)
    assert len(views) == _MAX_KEPT
    kept = room.view(GAME, 32, 24, moved=False)  # rendered anew, for it was dropped
    assert np.array_equal(kept, room.view(GAME, 32, 24))


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The share of its picture of each rendering for a view."""
    shares: list[float] = []
    render = Camera.render

    def spy(camera: Camera, *, shadow: bool = True, window: Window | None = None) -> Rendering:
        part = render(camera, shadow=shadow, window=window)
        if not shadow:
            shares.append(part.bodies.size / (camera.width * camera.height))
        return part

    monkeypatch.setattr(Camera, "render", spy)
    return shares


@pytest.mark.parametrize("viewpoint", ["room", "hands"])
def test_of_a_view_only_what_moved_is_rendered_anew(
    room: Nao, viewpoint: ViewName, windows: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_SEEN", 0.0)
    room.rest()
    room.view(GAME, 320, 240, viewpoint)
    room.view(GAME, 320, 240, viewpoint)
    windows.clear()
    for keys in (Keys.UP | Keys.FIRE, Keys.RIGHT, Keys.NONE):
        room.command(keys)
        for _ in range(6):
            room.step_frame()
        seen = room.view(GAME, 320, 240, viewpoint)
        room._views._views.clear()
        new = room.view(GAME, 320, 240, viewpoint)
        # Rounding differs at a few edges between shades.
        off = abs(seen.astype(int) - new)
        assert off.max() <= 2
        assert (off > 0).mean() < 0.001
    # Only all of it, and then the window.
    assert windows[1::2] == [1.0] * 3
    assert 0.0 < max(windows[::2]) < 0.65


def set_key(room: Nao, key: Keys, depth: float) -> None:
    joint = dict(zip(KEY_PLACES, dict(room.controller.movables), strict=True))[key]
    room._engine.resetJointState(room.controller.body, joint, depth)


def test_a_key_that_changes_its_colour_is_drawn_anew_however_little_it_moves(room: Nao) -> None:
    """It moves by 0.02 mm; of other things, what moves by 0.1 m / 320 = 0.3 mm is drawn."""
    room.rest()
    for depth, held in ((PRESS_DEPTH - 1e-5, Keys.NONE), (PRESS_DEPTH + 1e-5, Keys.UP)):
        set_key(room, Keys.UP, depth)
        assert room.controller.pressed() == held
        assert any_green(room.view(GAME, 320, 240, "hands")) == bool(held)
    room.rest()


def test_what_moves_slowly_is_drawn_once_it_has_moved_enough(
    room: Nao, windows: list[float]
) -> None:
    """Up goes down by 0.1 mm a picture, beside a button that moves by 1 mm. What moved by more than
    0.1 m / 320 = 0.31 mm since it was last drawn is in the window: Up in every fourth picture."""
    room.rest()
    for number in range(14):
        set_key(room, Keys.UP, number * 1e-4)
        set_key(room, Keys.FIRE, number % 2 * 1e-3)
        room.view(GAME, 320, 240, "hands")
    least = min(windows)  # of the button alone
    assert [number for number, share in enumerate(windows) if share > 1.5 * least] == [0, 4, 8, 12]
    room.rest()


def test_of_a_view_without_visible_movement_nothing_is_rendered_anew(
    room: Nao, windows: list[float]
) -> None:
    room.rest()
    for _ in range(60):  # until the arms hang still
        room.step_frame()
    room.view(GAME, 320, 240, "hands")
    windows.clear()
    room.step_frame()
    room.view(GAME, 320, 240, "hands")
    assert windows == []


def test_where_the_scene_is_not_known_whole_all_is_rendered(
    room: Nao, windows: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scene, "_shape", lambda engine, data: None)
    monkeypatch.setattr(room._views, "_scene", None)
    for _ in range(2):
        room.view(GAME, 48, 32, "front")
    assert windows == [1.0, 1.0]
    room._views._scene = None

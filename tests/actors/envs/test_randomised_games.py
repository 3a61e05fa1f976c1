"""Games under drawn conditions: applied to hands and eye, seeded, and seen by the detector."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from actors.envs import make_env
from actors.envs.ale import AtariEnv
from actors.envs.emulator import Emulator
from actors.envs.frame_camera import FrameCamera
from actors.envs.observation import frames_and_vector
from actors.envs.robot import RobotEnv
from actors.vision.layout import GAME_IN_PICTURE
from common.errors import InputError
from common.settings.conditions import CameraConfig, PlayConfig
from common.settings.config import RunConfig
from common.settings.ranges import RandomiseConfig, all_ranges, draw
from tests.actors.envs.narrowed import frames_of, nao_of

PLAY = PlayConfig(random_starts=3, vector=True)


@pytest.fixture(scope="module")
def robot() -> Iterator[RobotEnv]:
    env = RobotEnv("pong", play=PLAY, randomise=all_ranges("robot"))
    yield env
    env.close()


def trace(env: gymnasium.Env[Any, Any], seed: int | None, steps: int = 30) -> list[Any]:
    observation, info = env.reset(seed=seed, options={"new_game": True})
    seen: list[Any] = [*(each.tobytes() for each in frames_and_vector(observation)), info]
    for step in range(steps):
        observation, reward, *_, info = env.step(step // 2 % 6)
        seen += [*(each.tobytes() for each in frames_and_vector(observation)), reward, info]
    return seen


def settings_of(env: RobotEnv) -> tuple[Any, ...]:
    """What hands and eye of NAO are really set to."""
    nao = nao_of(env)
    return (
        nao.arms.left._speeds[0] / 8.26797,
        nao.controller._closes[0],
        nao.camera,
        env._world._hands._latency,  # type: ignore[attr-defined]
        env.emulator.sticky,
        env._eye._detector._distortion,
    )


def test_a_game_is_played_under_the_conditions_that_its_seed_draws(robot: RobotEnv) -> None:
    for seed in (3, 4):
        robot.reset(seed=seed)
        rng = np.random.default_rng(seed)
        play, camera, _ = draw(PLAY, CameraConfig(), all_ranges("robot"), rng.random)
        assert settings_of(robot) == (
            pytest.approx(0.9 * play.arm_speed),
            pytest.approx(0.002 * play.key_threshold),
            camera,
            play.actuation_latency,
            play.sticky,
            camera.distortion,
        )


def test_seeded_games_repeat_whatever_was_played_before(robot: RobotEnv) -> None:
    first, other = trace(robot, 7), trace(robot, 8)
    assert trace(robot, 7) == first != other
    fresh = RobotEnv("pong", play=PLAY, randomise=all_ranges("robot"))
    assert trace(fresh, 7) == first
    # So do the games after a seeded one, each of which has conditions of its own.
    cameras = []
    for env in (robot, fresh):
        trace(env, 9, steps=3)
        after = trace(env, None, steps=20)
        cameras.append((nao_of(env).camera, after))
    assert cameras[0] == cameras[1]
    fresh.close()


def test_a_lost_life_changes_no_conditions() -> None:
    play = PlayConfig(random_starts=0, minimal_actions=True)
    env = RobotEnv("breakout", play=play, randomise=all_ranges("robot"), training=True)
    env.reset(seed=1)
    before = env.conditions
    while not env.step(1)[2]:
        pass
    env.reset()
    assert env.conditions is before
    env.reset(options={"new_game": True})
    assert env.conditions != before
    env.close()


@pytest.mark.parametrize(("game", "seeds"), [("pong", range(15)), ("asteroids", range(15, 30))])
def test_the_screen_is_found_under_all_conditions(game: str, seeds: range) -> None:
    """In 0.99 of the pictures of 30 games over all of the published ranges."""
    env = RobotEnv(game, play=PlayConfig(random_starts=0), randomise=all_ranges("robot"))
    valid = []
    for seed in seeds:
        _, info = env.reset(seed=seed)
        valid.append(info["valid_frame"])
        for action in (2, 5, 3):
            valid.append(env.step(action)[4]["valid_frame"])
    assert np.mean(valid) >= 0.99
    env.close()


def test_a_late_picture_of_a_drawn_latency_is_the_one_before() -> None:
    """What a robot with a perfect eye sees, an agent step later."""
    ranges = RandomiseConfig(picture_latency=2)
    late, prompt = (
        RobotEnv(play=PlayConfig(random_starts=0), randomise=each)
        for each in (ranges, RandomiseConfig())
    )
    latencies = set()
    for seed in range(6):
        frames = []
        for env in (late, prompt):
            states = [env.reset(seed=seed)[0], *(env.step(2)[0] for _ in range(6))]
            frames.append([frames_of(state)[-1] for state in states])
        latency = late.conditions.camera.latency
        latencies.add(latency)
        expected = [frames[1][max(0, step - latency)] for step in range(7)]
        assert np.array_equal(frames[0], expected)
    assert latencies == {0, 1, 2}
    late.close()
    prompt.close()


def test_lost_pictures_reach_the_network_as_frames_seen_before() -> None:
    play = PlayConfig(random_starts=0)
    for env in (
        RobotEnv(play=play, camera=CameraConfig(dropped=1.0)),
        AtariEnv(play=play, camera=CameraConfig(dropped=1.0)),
    ):
        state, _ = env.reset(seed=1)
        for _ in range(4):
            later, *_, info = env.step(2)
            assert info["valid_frame"]
        assert np.array_equal(frames_of(later), frames_of(state))
        env.close()


@pytest.mark.parametrize("env_name", ["robot", "ale"])
def test_a_reset_may_ask_for_a_share_of_the_ranges(env_name: str, robot: RobotEnv) -> None:
    ranges = all_ranges(env_name)
    env = robot if env_name == "robot" else AtariEnv("pong", play=PLAY, randomise=ranges)
    env.reset(seed=3, options={"difficulty": 0.25})
    quarter, whole = (
        draw(PLAY, CameraConfig(), ranges, np.random.default_rng(3).random, share)
        for share in (0.25, 1.0)
    )
    assert env.conditions == quarter != whole


@pytest.mark.parametrize("share", [-0.1, 1.1, float("nan"), "half", None])
def test_a_share_that_is_none_is_refused(share: Any) -> None:
    env = AtariEnv("pong", play=PLAY, randomise=all_ranges("ale"))
    with pytest.raises(InputError, match="difficulty"):
        env.reset(seed=3, options={"difficulty": share})


def test_the_emulator_draws_conditions_for_each_game_too() -> None:
    env = AtariEnv("pong", play=PLAY, randomise=all_ranges("ale"))
    first, other = trace(env, 7), trace(env, 8)
    assert trace(env, 7) == first != other
    assert trace(AtariEnv("pong", play=PLAY, randomise=all_ranges("ale")), 7) == first
    stickiness = set()
    for _ in range(5):
        env.reset(options={"new_game": True})
        stickiness.add(env.emulator.sticky)
        assert 0 < env.emulator.sticky < 0.25
    assert len(stickiness) == 5


@pytest.mark.parametrize(
    "ranges", [RandomiseConfig(actuation_latency=8), RandomiseConfig(press_latency=8)]
)
def test_the_emulators_keys_have_the_drawn_latency(ranges: RandomiseConfig) -> None:
    env = AtariEnv("pong", play=PLAY, randomise=ranges)
    for seed in range(8):
        env.reset(seed=seed)
        rng = np.random.default_rng(seed)
        drawn = draw(PLAY, CameraConfig(), ranges, rng.random).play
        latency = drawn.actuation_latency + drawn.press_latency
        felt: list[float] = []
        for _ in range(3):
            _, vector = frames_and_vector(env.step(2)[0])
            felt += vector[108:128].reshape(4, 5)[:, 0].tolist()
        assert felt == [0.0] * latency + [1.0] * (12 - latency)


def test_the_emulators_frame_has_the_tones_of_an_eye() -> None:
    settings = CameraConfig(gamma=2.0, ambient=0.2, brightness=0.8)
    env = AtariEnv("pong", play=PlayConfig(random_starts=0), camera=settings)
    frame = frames_of(env.reset(seed=1)[0])[-1]
    # Where the picture is of one grey, no matter how it is sampled.
    screen = Emulator("pong", 0).screen_grey()
    for row, column in ((50, 40), (12, 20), (82, 60)):
        grey = float(screen[row * 210 // 84, column * 160 // 84])
        lit = 255 - 0.8 * (255 - grey)
        assert frame[row, column] == pytest.approx((0.8 * lit / 255) ** 2 * 255, abs=1.5)


@pytest.mark.parametrize("fault", [CameraConfig(noise=8.0), CameraConfig(blur=1.0)])
def test_noise_and_blur_do_as_much_to_the_emulators_frame_as_to_the_robots(
    fault: CameraConfig,
) -> None:
    play = PlayConfig(random_starts=0)
    harm = []
    for kind in (AtariEnv, RobotEnv):
        # A little noise, which rounding takes away: both look through a camera.
        envs = [kind("pong", play=play, camera=each) for each in (CameraConfig(noise=1e-6), fault)]
        for env in envs:
            env.reset(seed=1)
        differences = []
        for step in range(20):
            own, seen = (
                frames_and_vector(env.step(step // 4 % 6)[0])[0][-1].astype(float) for env in envs
            )
            differences.append(np.square(seen - own).mean())
        harm.append(np.sqrt(np.mean(differences)))
        for env in envs:
            env.close()
    assert harm[0] == pytest.approx(harm[1], rel=0.2)


def test_glare_shines_where_it_would_on_the_robots_screen() -> None:
    """In the middle of the upper left quarter of the game, as a bell of 0.15 of the picture."""
    span = GAME_IN_PICTURE[2] - GAME_IN_PICTURE[0]
    x, y = (GAME_IN_PICTURE[0] + 0.25 * span).tolist()
    settings = CameraConfig(glare=0.5, glare_x=x, glare_y=y)
    black: NDArray[np.uint8] = np.zeros((210, 160), np.uint8)
    camera = FrameCamera(settings)
    camera.begin_game(np.random.default_rng(0))
    seen = camera.take(black, 0)
    assert seen[20:22, 20:22] == pytest.approx(127, abs=1)
    # One standard deviation to the right: 0.15 of a picture that is 1.16 games wide.
    away = round(20.5 + 0.15 * 1.16 * 84)
    assert seen[20, away] == pytest.approx(127.5 * np.exp(-0.5), abs=2)
    # As far down in the room: the picture is 4 wide and 3 high.
    below = round(20.5 + 0.15 * 1.16 * 84 * 4 / 3)
    assert seen[below, 20] == pytest.approx(127.5 * np.exp(-0.5), abs=2)


def test_make_env_takes_camera_and_ranges_from_the_configuration() -> None:
    ranges = RandomiseConfig(actuation_latency=3, sticky=0.2)
    for kind in ("ale", "robot"):
        config = RunConfig(env=kind, camera=CameraConfig(gamma=1.5), randomise=ranges)
        env = make_env(replace(config, play=PLAY), training=False)
        assert isinstance(env, (AtariEnv, RobotEnv))
        env.reset(seed=3)
        random = gymnasium.utils.seeding.np_random(3)[0].random
        assert env.conditions == draw(PLAY, config.camera, ranges, random)
        env.close()

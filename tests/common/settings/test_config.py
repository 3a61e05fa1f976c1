"""RunConfig: the bounds of each setting with their sentence, and the schedules by hand."""

import dataclasses
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from common.errors import InputError
from common.run.rules import check_config
from common.settings.conditions import MAX_WAIT
from common.settings.config import ExplorationConfig, LearningConfig, ReplayConfig, RunConfig
from common.settings.presets import PRESETS

GOOD = PRESETS["fast"]


def changed(field: str, value: Any, config: RunConfig = GOOD) -> RunConfig:
    """``config`` with ``group.name`` or ``name`` set to ``value``."""
    group, _, name = field.rpartition(".")
    changes: dict[str, Any] = {name: value}
    if not group:
        return replace(config, **changes)
    changes = {group: replace(getattr(config, group), **changes)}
    return replace(config, **changes)


def test_the_defaults_pass() -> None:
    check_config(RunConfig())


AT_LEAST_1 = [
    "play.frame_skip",
    "play.vector_commands",
    "play.vector_key_frames",
    "stream.chunk_steps",
    "stream.window",
    "learning.batch_size",
    "learning.train_period",
    "learning.n_step",
    "learning.target_update_period",
    "learning.publish_period",
    "learning.checkpoint_period",
    "protocol.epoch_steps",
    "protocol.test_steps",
]
SHARES = [
    "exploration.start",
    "exploration.end",
    "protocol.test_epsilon",
    "learning.discount",
    "replay.priority_exponent",
    "replay.importance_exponent",
]
OF_EITHER_SIGN = ["camera.yaw", "camera.pitch", "camera.screen_tilt"]
NUMBERS = [
    f"{group}.{name}"
    for group, values in dataclasses.asdict(GOOD).items()
    if isinstance(values, dict)
    for name, value in values.items()
    if type(value) in (int, float) and f"{group}.{name}" not in OF_EITHER_SIGN
]


@pytest.mark.parametrize("field", NUMBERS)
@pytest.mark.parametrize("value", [-1, float("nan"), float("inf"), float("-inf")])
def test_no_number_is_negative_or_endless(field: str, value: float) -> None:
    advice = "(: choose|, which is not a whole number)"
    with pytest.raises(InputError, match=f"^{field} is {value}{advice}"):
        check_config(changed(field, value))


@pytest.mark.parametrize("field", AT_LEAST_1)
def test_what_must_be_1_or_more(field: str) -> None:
    with pytest.raises(InputError, match=f"^{field} is 0: choose 1 or more.$"):
        check_config(changed(field, 0))


@pytest.mark.parametrize("field", SHARES)
def test_shares_end_at_1(field: str) -> None:
    check_config(changed(field, 1.0))
    check_config(changed(field, 0.0))
    with pytest.raises(InputError, match=rf"^{field} is 1.01: choose at most 1\.$"):
        check_config(changed(field, 1.01))


@pytest.mark.parametrize(
    ("field", "least", "most"), [("play.frame_stack", 2, 16), ("play.wait_bound", 1, MAX_WAIT)]
)
def test_ranges(field: str, least: int, most: int) -> None:
    few = changed("protocol.held_out_states", 512)  # as many as long states allow
    for value in (least, most):
        check_config(changed(field, value, few))
    for value, advice in ((least - 1, f"{least} or more"), (most + 1, f"at most {most}")):
        with pytest.raises(InputError, match=rf"^{field} is {value}: choose {advice}\.$"):
            check_config(changed(field, value, few))


def test_a_mean_over_squares_must_forget() -> None:
    with pytest.raises(InputError, match=r"^learning.rmsprop_decay is 1.0: choose less than 1\.$"):
        check_config(changed("learning.rmsprop_decay", 1.0))
    check_config(changed("learning.rmsprop_decay", 0.99))


@pytest.mark.parametrize(
    ("field", "most", "beyond"),
    [
        ("camera.noise", 255.0, 256.0),
        ("camera.blur", 20.0, 20.5),
        ("camera.brightness", 2.0, 2.1),
        ("camera.gamma", 3.0, 3.1),
        ("camera.glare", 0.9, 1.0),
        ("camera.distortion", 0.3, 0.31),
        ("camera.latency", 3, 4),
        ("camera.yaw", 45.0, 46.0),
        ("camera.pitch", 45.0, 46.0),
        ("camera.screen_tilt", 30.0, 31.0),
        ("camera.ambient", 0.9, 1.0),
        ("learning.random_shift", 20, 21),
        ("play.actuation_latency", 36, 37),
        ("play.actuation_jitter", 36, 37),
        ("play.arm_speed", 1.1, 1.2),
        ("play.key_threshold", 1.4, 1.5),
        ("play.frame_skip", 60, 61),
        ("play.random_starts", 10_000, 10_001),
    ],
)
def test_upper_bounds(field: str, most: float, beyond: float) -> None:
    check_config(changed(field, most, replace(GOOD, env="robot")))
    with pytest.raises(InputError, match=f"^{field} is {beyond}: choose at most"):
        check_config(changed(field, beyond))


def test_a_chunk_has_at_most_1024_steps() -> None:
    config = changed("replay.ratio_tolerance", 10_000)
    check_config(changed("stream.chunk_steps", 1_024, config))
    with pytest.raises(InputError, match=r"^stream.chunk_steps is 1025: choose at most 1024\.$"):
        check_config(changed("stream.chunk_steps", 1_025, config))


def test_at_most_64_chunks_of_an_actor_are_under_way() -> None:
    config = changed("replay.ratio_tolerance", 10_000)
    check_config(changed("stream.window", 64, config))
    with pytest.raises(InputError, match=r"^stream.window is 65: choose at most 64\.$"):
        check_config(changed("stream.window", 65, config))


def test_a_file_that_is_named_gets_its_hash(tmp_path: Path) -> None:
    assert GOOD.pinned() is GOOD
    file = tmp_path / "hand.npz"
    file.write_bytes(b"abc")
    config = changed("play.robot", str(file)).pinned()
    assert config.play.robot.startswith(f"{file}#sha256=ba7816bf")
    assert config == changed("play.robot", config.play.robot)
    assert config.play.latency_model == config.play.robot
    assert GOOD.play.latency_model is None
    with pytest.raises(InputError, match="cannot be read"):
        changed("play.robot", str(tmp_path / "none.npz")).pinned()


@pytest.mark.parametrize(
    ("agent_steps", "epsilon"),
    [
        (0, 1.0),
        (50, 1.0),
        (100, 1.0),
        (101, 0.996),
        (150, 0.8),
        (200, 0.6),
        (300, 0.2),
        (301, 0.2),
        (10**12, 0.2),
    ],
)
def test_epsilon_falls_in_a_line_after_the_warm_up(agent_steps: int, epsilon: float) -> None:
    schedule = ExplorationConfig(start=1.0, end=0.2, steps=200)
    config = replace(GOOD, replay=ReplayConfig(learning_starts=100), exploration=schedule)
    assert config.epsilon_at(agent_steps) == pytest.approx(epsilon, abs=1e-12)


def test_epsilon_of_a_schedule_without_length_jumps() -> None:
    schedule = ExplorationConfig(start=0.9, end=0.1, steps=0)
    config = replace(GOOD, replay=ReplayConfig(learning_starts=100), exploration=schedule)
    assert config.epsilon_at(100) == pytest.approx(0.9)
    assert config.epsilon_at(101) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("gone", "share"), [(0, 0.0), (50_000, 0.25), (200_000, 1.0), (10**9, 1.0)]
)
def test_a_curriculum_ends_with_whole_ranges(gone: int, share: float) -> None:
    config = PRESETS["robot"]
    assert config.difficulty_after(gone) == 1.0
    learning = replace(config.learning, curriculum_steps=200_000)
    assert replace(config, learning=learning).difficulty_after(gone) == share


@pytest.mark.parametrize(("batch", "every", "ratio"), [(32, 4, 8.0), (32, 1, 32.0), (1, 4, 0.25)])
def test_samples_per_insert(batch: int, every: int, ratio: float) -> None:
    config = replace(GOOD, learning=LearningConfig(batch_size=batch, train_period=every))
    assert config.samples_per_insert == ratio


@pytest.mark.parametrize(
    ("env", "robot", "played"),
    [
        ("ale", "nao", "breakout (ale)"),
        ("robot", "nao", "breakout (robot)"),
        ("robot", "robotroller", "breakout (robotroller)"),
        ("robot", "/bodies/arm.npz", "breakout (arm.npz)"),
    ],
)
def test_another_robot_than_the_usual_is_told(env: str, robot: str, played: str) -> None:
    config = changed("play.robot", robot, changed("game", "breakout", changed("env", env)))
    assert config.played == played

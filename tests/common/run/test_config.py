"""RunConfig: each rule with its sentence, and the schedules by hand."""

import dataclasses
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.errors import InputError, MessageError
from common.proprioception import vector_width
from common.protocol.step_fields import FRAME_SHAPE, STEP_FIELDS, Column, StepField
from common.run.conditions import MAX_WAIT, PlayConfig
from common.run.config import ExplorationConfig, LearningConfig, ReplayConfig, RunConfig
from common.run.presets import PRESETS
from replay.batch import SharedBatch
from replay.messages import HeldOutStates

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
    RunConfig().check()


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
        changed(field, value).check()


@pytest.mark.parametrize("field", AT_LEAST_1)
def test_what_must_be_1_or_more(field: str) -> None:
    with pytest.raises(InputError, match=f"^{field} is 0: choose 1 or more.$"):
        changed(field, 0).check()


@pytest.mark.parametrize("field", SHARES)
def test_shares_end_at_1(field: str) -> None:
    changed(field, 1.0).check()
    changed(field, 0.0).check()
    with pytest.raises(InputError, match=rf"^{field} is 1.01: choose at most 1\.$"):
        changed(field, 1.01).check()


@pytest.mark.parametrize(
    ("field", "least", "most"), [("play.frame_stack", 2, 16), ("play.wait_bound", 1, MAX_WAIT)]
)
def test_ranges(field: str, least: int, most: int) -> None:
    few = changed("protocol.held_out_states", 512)  # as many as long states allow
    for value in (least, most):
        changed(field, value, few).check()
    for value, advice in ((least - 1, f"{least} or more"), (most + 1, f"at most {most}")):
        with pytest.raises(InputError, match=rf"^{field} is {value}: choose {advice}\.$"):
            changed(field, value, few).check()


def test_a_vector_fits_into_a_chunk() -> None:
    widest = changed("play.vector", True, replace(PRESETS["robot"]))
    for field, number in (("play.vector_commands", 30), ("play.vector_key_frames", 60)):
        widest = changed(field, number, widest)
    widest.check()
    with pytest.raises(InputError, match=r"^the vector observation has 1396 numbers: lower"):
        changed("play.vector_commands", 60, widest).check()


@pytest.mark.parametrize("drawn", [{}, {"before": Column(84, 84, drawn=True)}])
def test_states_that_travel_together_fit_a_message(
    drawn: dict[str, Column], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, column in drawn.items():
        monkeypatch.setitem(STEP_FIELDS, name, StepField(np.dtype(np.uint8), column))

    def held(states: int, frame_stack: int) -> bytes:
        frames = np.zeros((states, frame_stack, *FRAME_SHAPE), np.uint8)
        return HeldOutStates(
            frames, np.zeros((states, vector_width(PlayConfig(), 8)), np.float32)
        ).encode()

    def minibatch(steps: int, frame_stack: int) -> bytes:
        vectors = np.zeros((steps, vector_width(PlayConfig(), 8)), np.float32)
        return SharedBatch(
            frames=np.zeros((2 * steps * frame_stack, *FRAME_SHAPE), np.uint8),
            stacks=np.zeros((2, steps, frame_stack), np.int32),
            ids=np.zeros(steps, np.int64),
            a_tm1=np.zeros(steps, np.uint8),
            **{name: np.zeros(steps, np.float32) for name in ("r_t", "discount_t", "weights")},
            x_tm1=vectors,
            x_t=vectors,
            drawn={name: np.zeros((steps, 84, 84), np.uint8) for name in drawn},
        ).encode()

    for frame_stack in (2, 4, 16):
        config = changed("play.vector", True, changed("play.frame_stack", frame_stack))
        config = replace(changed("protocol.held_out_states", 1, config), env="robot")
        for field, message in (
            ("protocol.held_out_states", held),
            ("learning.batch_size", minibatch),
        ):
            with pytest.raises(InputError, match=f"^{field} is 99999: choose a number") as caught:
                changed(field, 99_999, config).check()
            most = int(re.findall(r"from 1 to (\d+)", str(caught.value))[0])
            message(most, frame_stack)
            with pytest.raises(MessageError, match="over the bound"):
                message(round(1.01 * most), frame_stack)
            with pytest.raises(InputError, match=f"^{field} is {most + 1}: choose a number"):
                changed(field, most + 1, config).check()
            with pytest.raises(InputError, match=f"^{field} is 0: choose"):
                changed(field, 0, config).check()


def test_a_mean_over_squares_must_forget() -> None:
    with pytest.raises(InputError, match=r"^learning.rmsprop_decay is 1.0: choose less than 1\.$"):
        changed("learning.rmsprop_decay", 1.0).check()
    changed("learning.rmsprop_decay", 0.99).check()


def test_an_annealed_learning_rate_never_rises() -> None:
    annealed = changed("learning.annealing_steps", 1_000)
    low = changed("learning.final_learning_rate", 1e-5, annealed)
    changed("learning.learning_rate", 1e-5, low).check()
    with pytest.raises(InputError, match=r"^learning.learning_rate 5e-06 would rise to .* 1e-05"):
        changed("learning.learning_rate", 5e-6, low).check()
    constant = changed("learning.annealing_steps", 0, low)
    changed("learning.learning_rate", 5e-6, constant).check()


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
        ("play.vector_commands", 60, 61),
        ("play.vector_key_frames", 240, 241),
        ("play.actuation_jitter", 36, 37),
        ("play.arm_speed", 1.1, 1.2),
        ("play.key_threshold", 1.4, 1.5),
        ("play.frame_skip", 60, 61),
        ("play.random_starts", 10_000, 10_001),
    ],
)
def test_upper_bounds(field: str, most: float, beyond: float) -> None:
    changed(field, most, replace(GOOD, env="robot")).check()
    with pytest.raises(InputError, match=f"^{field} is {beyond}: choose at most"):
        changed(field, beyond).check()


def test_a_chunk_has_at_most_1024_steps() -> None:
    config = changed("replay.ratio_tolerance", 10_000)
    changed("stream.chunk_steps", 1_024, config).check()
    with pytest.raises(InputError, match=r"^stream.chunk_steps is 1025: choose at most 1024\.$"):
        changed("stream.chunk_steps", 1_025, config).check()


def test_at_most_64_chunks_of_an_actor_are_under_way() -> None:
    config = changed("replay.ratio_tolerance", 10_000)
    changed("stream.window", 64, config).check()
    with pytest.raises(InputError, match=r"^stream.window is 65: choose at most 64\.$"):
        changed("stream.window", 65, config).check()


def test_the_warm_up_fills_a_minibatch() -> None:
    # 128 transitions of 5 steps each.
    changed("replay.learning_starts", 133).check()
    with pytest.raises(InputError, match=r"^replay.learning_starts is 132: .* at least 133 steps"):
        changed("replay.learning_starts", 132).check()


def test_the_ring_holds_the_warm_up_and_two_chunks() -> None:
    # 10,000 + 2 × 64.
    changed("replay.capacity", 10_128).check()
    with pytest.raises(InputError, match=r"^replay.capacity is 10127, .* needs 10128 slots"):
        changed("replay.capacity", 10_127).check()


def test_the_tolerance_holds_an_actors_window() -> None:
    # 64 steps × 4 chunks.
    changed("replay.ratio_tolerance", 256).check()
    with pytest.raises(InputError, match=r"^replay.ratio_tolerance is 255, .* at least 256"):
        changed("replay.ratio_tolerance", 255).check()


def test_the_tolerance_holds_the_steps_of_one_update() -> None:
    config = changed("learning.train_period", 2_000)
    changed("replay.ratio_tolerance", 2_000, config).check()
    with pytest.raises(InputError, match=r"^replay.ratio_tolerance is 1999, .* at least 2000"):
        changed("replay.ratio_tolerance", 1_999, config).check()


@pytest.mark.parametrize("env", ["ale", "robot"])
@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("play.hand", "model"),
        ("play.press_latency", 1),
    ],
)
def test_hands_are_modelled_once(env: str, field: str, value: Any) -> None:
    modelled = changed("play.robot", "a/hand.npz#sha256=0", changed("env", env))
    modelled.check()
    changed(field, value).check()
    with pytest.raises(InputError, match=r"^play.robot is a/hand.npz, which models .*: leave"):
        changed(field, value, modelled).check()


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

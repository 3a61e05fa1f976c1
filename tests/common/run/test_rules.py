"""The rules between settings: each with its sentence."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from common.errors import InputError, MessageError
from common.proprioception import vector_width
from common.protocol.step_fields import FRAME_SHAPE, STEP_FIELDS, Column, StepField
from common.registry import ENVIRONMENTS
from common.run.rules import check_chosen, check_config
from common.settings.conditions import PlayConfig
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from common.settings.ranges import all_ranges
from replay.batch import SharedBatch
from replay.messages import HeldOutStates
from tests.common.settings.test_config import changed
from tests.extending.whole_run import added


def test_a_vector_fits_into_a_chunk() -> None:
    widest = changed("play.vector", True, replace(PRESETS["robot"]))
    for field, number in (("play.vector_commands", 30), ("play.vector_key_frames", 60)):
        widest = changed(field, number, widest)
    check_config(widest)
    with pytest.raises(InputError, match=r"^the vector observation has 1396 numbers: lower"):
        check_config(changed("play.vector_commands", 60, widest))
    for field, beyond in (("play.vector_commands", 61), ("play.vector_key_frames", 241)):
        with pytest.raises(InputError, match=f"^{field} is {beyond}: choose at most"):
            check_config(changed(field, beyond, widest))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("vector_commands", 20),
        ("vector_key_frames", 20),
        ("vector_forecast", 8),
        ("vector_joints", False),
    ],
)
def test_a_part_of_a_vector_is_not_chosen_without_it(field: str, value: object) -> None:
    before = PRESETS["robot"]
    config = changed(f"play.{field}", value, before)
    with pytest.raises(InputError, match=rf"^play.{field} is {value}, which .* play.vector: give"):
        check_chosen(before, config)
    check_chosen(before, changed("play.vector", True, config))
    check_config(config)  # a run that was stored with it
    check_chosen(config, config)


@pytest.mark.parametrize(
    ("field", "value", "needs"),
    [
        ("play.press_latency", 3, {"play.hand": "model"}),
        ("play.arm_speed", 0.5, {"play.hand": "arm"}),
        ("play.key_threshold", 1.2, {"play.hand": "arm"}),
        ("camera.noise", 8.0, {"play.eye": "camera"}),
        ("camera.yaw", 2.0, {"play.eye": "camera"}),
        ("randomise.press_latency", 2, {"play.hand": "model"}),
        ("randomise.arm_speed", 0.4, {"play.hand": "arm"}),
        ("randomise.head_pose", 4.0, {"play.eye": "camera"}),
    ],
)
def test_a_property_of_what_is_not_used_is_not_chosen(
    field: str, value: object, needs: dict[str, object]
) -> None:
    other = {"play.hand": {"model": "arm", "arm": "model"}, "play.eye": {"camera": "emulator"}}
    [(setting, needed)] = needs.items()
    before = changed(setting, other[setting][str(needed)], PRESETS["robot"])
    config = changed(field, value, before)
    told = rf"^{field} is {value}, which means nothing .*: give {setting} {needed}"
    with pytest.raises(InputError, match=told):
        check_chosen(before, config)
    check_chosen(before, changed(setting, needed, config))
    check_config(config)  # a run that was stored with it
    check_chosen(config, config)
    check_chosen(config, before)  # which turns it off


@pytest.mark.parametrize(("field", "value"), [("play.eye", "emulator"), ("play.hand", "model")])
def test_no_part_of_a_robot_is_chosen_without_one(field: str, value: str) -> None:
    config = changed(field, value, PRESETS["fast"])
    with pytest.raises(InputError, match=rf"^{field} is {value}, .* without a robot: choose env"):
        check_chosen(PRESETS["fast"], config)
    check_chosen(config, replace(config, env="ale"))  # as the emulator alone plays a robot's policy


def test_a_latency_model_has_no_arms() -> None:
    before = changed("play.robot", "a/hand.npz", PRESETS["robot"])
    with pytest.raises(InputError, match=r"arm_speed is 0.5, .* to a latency model: choose anoth"):
        check_chosen(before, changed("play.arm_speed", 0.5, before))


def test_all_ranges_may_be_drawn_whatever_the_hands_and_the_eye() -> None:
    before = changed("play.eye", "emulator", PRESETS["robot"])
    check_chosen(before, replace(before, randomise=all_ranges("robot")))


def test_the_emulator_alone_has_modelled_hands_and_a_camera_of_its_own() -> None:
    config = PRESETS["fast"]
    for field, value in (("play.press_latency", 3), ("camera.noise", 8.0)):
        check_chosen(PRESETS["fast"], config := changed(field, value, config))


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
                check_config(changed(field, 99_999, config))
            most = int(re.findall(r"from 1 to (\d+)", str(caught.value))[0])
            message(most, frame_stack)
            with pytest.raises(MessageError, match="over the bound"):
                message(round(1.01 * most), frame_stack)
            with pytest.raises(InputError, match=f"^{field} is {most + 1}: choose a number"):
                check_config(changed(field, most + 1, config))
            with pytest.raises(InputError, match=f"^{field} is 0: choose"):
                check_config(changed(field, 0, config))


def test_an_annealed_learning_rate_never_rises() -> None:
    annealed = changed("learning.annealing_steps", 1_000)
    low = changed("learning.final_learning_rate", 1e-5, annealed)
    check_config(changed("learning.learning_rate", 1e-5, low))
    with pytest.raises(InputError, match=r"^learning.learning_rate 5e-06 would rise to .* 1e-05"):
        check_config(changed("learning.learning_rate", 5e-6, low))
    constant = changed("learning.annealing_steps", 0, low)
    check_config(changed("learning.learning_rate", 5e-6, constant))


def test_the_warm_up_fills_a_minibatch() -> None:
    # 128 transitions of 5 steps each.
    check_config(changed("replay.learning_starts", 133))
    with pytest.raises(InputError, match=r"^replay.learning_starts is 132: .* at least 133 steps"):
        check_config(changed("replay.learning_starts", 132))


def test_the_ring_holds_the_warm_up_and_two_chunks() -> None:
    # 10,000 + 2 × 64.
    check_config(changed("replay.capacity", 10_128))
    with pytest.raises(InputError, match=r"^replay.capacity is 10127, .* needs 10128 slots"):
        check_config(changed("replay.capacity", 10_127))


def test_the_tolerance_holds_an_actors_window() -> None:
    # 64 steps × 4 chunks.
    check_config(changed("replay.ratio_tolerance", 256))
    with pytest.raises(InputError, match=r"^replay.ratio_tolerance is 255, .* at least 256"):
        check_config(changed("replay.ratio_tolerance", 255))


def test_the_tolerance_holds_the_steps_of_one_update() -> None:
    config = changed("learning.train_period", 2_000)
    check_config(changed("replay.ratio_tolerance", 2_000, config))
    with pytest.raises(InputError, match=r"^replay.ratio_tolerance is 1999, .* at least 2000"):
        check_config(changed("replay.ratio_tolerance", 1_999, config))


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
    check_config(modelled)
    check_config(changed(field, value))
    with pytest.raises(InputError, match=r"^play.robot is a/hand.npz, which models .*: leave"):
        check_config(changed(field, value, modelled))


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [("equal_gap", 4, "4, .*at 0"), ("hands_model", "a/m.npz#sha256=0", "a/m.npz, .*at ''")],
)
def test_some_settings_are_those_of_equal_hands(name: str, value: object, words: str) -> None:
    alone = changed(f"play.{name}", value, PRESETS["robot"])
    check_config(changed("play.equal_latency", 16, alone))
    with pytest.raises(InputError, match=rf"^play.{name} is {words}\.$"):
        check_config(alone)


@pytest.mark.parametrize("env", ["ale", "robot"])
def test_a_model_of_the_hands_needs_hands_that_take_as_many_commands(env: str) -> None:
    equal = changed("play.equal_latency", 16, changed("env", env, PRESETS["robot"]))
    planned = changed("play.hands_model", "a/m.npz#sha256=0", equal)
    of_a_file = changed("play.robot", "b.npz", planned)
    check_config(changed("play.robot_settings", "rate=60", of_a_file))
    with pytest.raises(InputError, match=r"takes 60 commands a second, and b.npz only 30: add"):
        check_config(of_a_file)
    without = {"ale": planned, "robot": changed("play.hand", "model", planned)}[env]
    with pytest.raises(InputError, match=r"^play.hands_model is a/m.npz, a model of hands that do"):
        check_config(without)


@pytest.mark.parametrize(
    ("group", "name", "value", "usual"),
    [
        ("camera", "yaw", 5.0, "0"),
        ("camera", "red", 1.1, "1"),
        ("camera", "distortion", 0.1, "0"),
        ("play", "arm_speed", 0.5, "1"),
        ("randomise", "head_pose", 5.0, "0"),
        ("randomise", "arm_speed", 0.1, "0"),
    ],
)
def test_the_emulator_alone_refuses_what_it_has_not(
    group: str, name: str, value: float, usual: str
) -> None:
    def config(env: str) -> RunConfig:
        settings = getattr(RunConfig(), group)
        return RunConfig(env=env, **{group: replace(settings, **{name: value})})

    check_config(config("robot"))
    with pytest.raises(
        InputError,
        match=f"^{group}.{name} is {value}, which means nothing in --env ale: leave it at {usual}",
    ):
        check_config(config("ale"))


@pytest.mark.parametrize(
    ("name", "value", "usual"),
    [("hand", "model", "arm"), ("minimal_actions", True, False), ("press_latency", 3, 0)],
)
def test_an_environment_may_refuse_settings_that_are_no_fractions(
    name: str, value: Any, usual: Any
) -> None:
    other = replace(ENVIRONMENTS.find("robot"), name="other", ignores=(f"play.{name}",))
    config = RunConfig(env="other", play=replace(PlayConfig(), **{name: value}))
    told = f"^play.{name} is {value}, .*: leave it at {usual}\\.$"
    with added(ENVIRONMENTS, other), pytest.raises(InputError, match=told):
        check_config(config)

"""Configurations in files: there and back, under former names, and compared."""

import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.checked import MAX_COUNT
from common.errors import InputError
from common.run.origin import SHIPPED, origin_of
from common.run.rules import check_config
from common.settings.conditions import FRAMES_PER_SECOND, MAX_STARTS, CameraConfig, PlayConfig
from common.settings.config import MAX_WINDOW, LearningConfig, RunConfig, StreamConfig
from common.settings.presets import PRESETS
from common.settings.ranges import RandomiseConfig
from common.settings.stored_config import (
    REMOVED,
    RENAMED,
    differences,
    flag_of,
    from_mapping,
    to_json,
)

GOOD = PRESETS["fast"]


@pytest.mark.parametrize("name", list(PRESETS))
def test_a_preset_survives_json(name: str) -> None:
    config = PRESETS[name]  # type: ignore[index]
    assert from_mapping(RunConfig, json.loads(to_json(config))) == config


@given(
    st.integers(0, 2**63 - 1),
    st.builds(
        PlayConfig,
        st.integers(2, 16),
        st.integers(1, FRAMES_PER_SECOND),
        st.integers(0, MAX_STARTS),
        st.booleans(),
        st.integers(0, MAX_COUNT),
    ),
    st.builds(
        LearningConfig,
        target=st.sampled_from(["dqn", "double"]),
        learning_rate=st.floats(0, allow_infinity=False),
        scale_pixels=st.booleans(),
    ),
    st.builds(StreamConfig, st.integers(1, 1_024), st.integers(1, MAX_WINDOW)),
)
def test_any_configuration_survives_json(
    seed: int, play: PlayConfig, learning: LearningConfig, stream: StreamConfig
) -> None:
    config = RunConfig(seed=seed, play=play, learning=learning, stream=stream)
    assert from_mapping(RunConfig, json.loads(to_json(config))) == config


def mapping(**changes: Any) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(to_json(GOOD))
    return found | changes


def test_a_missing_field_is_named() -> None:
    data = mapping()
    del data["replay"]["learning_starts"]
    with pytest.raises(
        InputError, match=r"^here.replay has a missing or unknown field: learning_starts\.$"
    ):
        from_mapping(RunConfig, data, "here")


def test_a_file_may_be_older_than_a_field_and_has_its_default() -> None:
    data = mapping()
    del data["learning"]["random_shift"]
    data["play"] = {}
    assert from_mapping(RunConfig, data, fill=True) == replace(GOOD, play=PlayConfig())
    data["learning"]["newer"] = 1
    with pytest.raises(InputError, match=r"^config.learning has a missing or unknown field: newer"):
        from_mapping(RunConfig, data, fill=True)
    del data["play"]
    with pytest.raises(InputError, match=r"^config has a missing or unknown field: play"):
        from_mapping(RunConfig, data, fill=True)


def test_a_file_may_have_the_former_names_of_fields() -> None:
    data = mapping()
    for former, present in RENAMED.items():
        (old_group, old), (group, new) = former.split("."), present.split(".")
        data[old_group][old] = data[group].pop(new)
    with pytest.raises(InputError, match="missing or unknown field"):
        from_mapping(RunConfig, data)
    assert from_mapping(RunConfig, data, fill=True) == GOOD


def test_a_latency_models_rate_is_found_where_it_is_declared_now() -> None:
    for rate, settings in ((30, ""), (60, "rate=60")):
        stored = json.loads(to_json(PRESETS["robot"]))
        del stored["play"]["robot_settings"]
        stored["play"]["model_rate"] = rate
        assert from_mapping(RunConfig, stored, fill=True).play.robot_settings == settings


def test_every_published_policy_can_be_read_by_this_version() -> None:
    found = [origin_of(file) for file in sorted(SHIPPED.glob("*.safetensors"))]
    assert len(found) >= 15
    assert None not in found


def test_a_file_may_have_fields_that_are_gone_where_they_did_nothing() -> None:
    data = mapping()
    for gone, usual in REMOVED.items():
        group, name = gone.split(".")
        data[group][name] = usual
    assert from_mapping(RunConfig, data, fill=True) == GOOD
    data["learning"]["dueling"] = True
    with pytest.raises(InputError, match=r"^run\.learning\.dueling is True, and is gone: "):
        from_mapping(RunConfig, data, "run", fill=True)


def test_a_field_that_is_gone_is_told_in_short_whatever_it_was() -> None:
    data = mapping()
    data["play"]["delay"] = "\x1b[2J" * 1_000
    with pytest.raises(InputError, match=r"^run\.play\.delay is '\\x1b\[2J.{,30}', and is gone: "):
        from_mapping(RunConfig, data, "run", fill=True)


def test_a_value_that_begins_like_a_flag_stays_with_its_own() -> None:
    assert flag_of("learning.n_step", 3) == ["--learning.n-step", "3"]
    assert flag_of("camera.yaw", -5.0) == ["--camera.yaw=-5.0"]
    assert flag_of("play.vector", False) == ["--play.no-vector"]


def test_a_field_under_both_of_its_names_is_refused() -> None:
    data = mapping()
    data["camera"]["delay"] = 3
    with pytest.raises(InputError, match=r"^config.camera has .* unknown field: delay\.$"):
        from_mapping(RunConfig, data, fill=True)


def test_a_file_from_before_conditions_were_drawn_has_what_the_camera_drew() -> None:
    """Ranges of the camera's faults moved to a group that such a file has not."""
    data = mapping()
    del data["randomise"]
    former = {"exposure": 0.3, "colour_gain": 0.2, "camera_jitter": 5.0, "screen_jitter": 0.15}
    data["camera"] = {"noise": 8.0, "delay": 1, "ambient": 0.1, **former}
    found = from_mapping(RunConfig, data, fill=True)
    assert found.camera == CameraConfig(noise=8.0, latency=1, ambient=0.1)
    assert found.randomise == RandomiseConfig(
        exposure=0.3, colour=0.2, head_pose=5.0, screen_distance=0.15
    )


def test_unknown_fields_are_named() -> None:
    with pytest.raises(InputError, match=r"^here has a missing or unknown field: aa, zz\.$"):
        from_mapping(RunConfig, mapping(zz=1, aa=2), "here")


@pytest.mark.parametrize("data", [None, [], "text", 5])
def test_what_is_no_table_is_refused(data: Any) -> None:
    with pytest.raises(InputError, match=r"^here should be a table of settings\.$"):
        from_mapping(RunConfig, data, "here")
    with pytest.raises(InputError, match=r"^here.play should be a table of settings\.$"):
        from_mapping(RunConfig, mapping(play=data), "here")


@pytest.mark.parametrize(
    ("field", "value", "sentence"),
    [
        ("seed", "1", "here.seed is '1', which is not a whole number."),
        ("seed", 1.0, "here.seed is 1.0, which is not a whole number."),
        ("seed", True, "here.seed is True, which is not a whole number."),
        ("seed", -1, "here.seed is -1: choose 0 or more."),
        ("game", 5, "here.game is 5, which is not a text."),
        ("env", ["ale"], "here.env is ['ale'], which is not a text."),
        ("preset", None, "here.preset is None: choose 'paper', 'fast', 'robot' or 'frugal'."),
    ],
)
def test_a_field_of_another_type_is_named(field: str, value: Any, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        from_mapping(RunConfig, mapping(**{field: value}), "here")
    assert str(caught.value) == sentence


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("scale_pixels", 1),
        ("learning_rate", "1e-4"),
        ("learning_rate", True),
        ("learning_rate", 10**400),  # no float is so large
    ],
)
def test_a_field_of_another_type_within_a_group_is_named(field: str, value: Any) -> None:
    data = mapping()
    data["learning"][field] = value
    with pytest.raises(InputError, match=rf"^here\.learning\.{field} is "):
        from_mapping(RunConfig, data, "here")


def test_a_whole_number_does_for_a_float() -> None:
    data = mapping()
    data["learning"]["gradient_norm"] = 10
    found = from_mapping(RunConfig, data)
    assert found == GOOD
    assert type(found.learning.gradient_norm) is float


@pytest.mark.parametrize("seed", [-1, 2**64])
def test_a_seed_that_no_generator_takes_is_refused(seed: int) -> None:
    # numpy takes no negative one, PyTorch none of more than 64 bits.
    with pytest.raises(InputError, match=f"^seed is {seed}: "):
        check_config(replace(GOOD, seed=seed))


def test_differences_name_each_field_and_both_values() -> None:
    assert differences(GOOD, GOOD) == []
    warm_up = replace(GOOD.replay, learning_starts=20_000)
    other = replace(GOOD, game="breakout", replay=warm_up)
    assert differences(GOOD, other) == [
        "game pong → breakout",
        "replay.learning_starts 10000 → 20000",
    ]
    lamps = replace(GOOD, play=replace(GOOD.play, env_settings="lamps=4"))
    assert differences(GOOD, lamps) == ["play.env_settings none → lamps=4"]
    assert differences(lamps, GOOD) == ["play.env_settings lamps=4 → none"]
    one, another = (
        replace(GOOD, play=replace(GOOD.play, robot=f"a.npz#sha256={digit * 64}")) for digit in "4b"
    )
    files = "play.robot a.npz#sha256=44444444… → a.npz#sha256=bbbbbbbb…"
    assert differences(one, another) == [files]

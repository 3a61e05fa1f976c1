"""Names and keys of a run."""

import pytest
import zenoh

from common.errors import InputError, MessageError
from common.protocol.run_keys import RunKeys, check_name, name_in, replay_of, run_id_of


def test_a_run_with_other_settings_is_another_with_the_same_replay() -> None:
    before, after = (run_id_of("0f" * 16, settings) for settings in ("{}", '{"new": 0}'))
    assert before != after
    assert replay_of(before) == replay_of(after) == "0f" * 16


@pytest.mark.parametrize("name", ["a", "7", "robot-pong.2_b", "A" * 64])
def test_a_name_that_fits_is_kept(name: str) -> None:
    assert check_name("run", name) == name


@pytest.mark.parametrize(
    "name",
    ["", ".", "..", "-a", "_a", "a/b", "a b", "a*", "*", "a$*", "a#", "a?", "ä", "a\n", "A" * 65],
)
def test_a_name_that_could_be_a_path_or_a_pattern_is_refused(name: str) -> None:
    words = r"^actor .* cannot be used: give it a name of up to 64 letters"
    with pytest.raises(InputError, match=words):
        check_name("actor", name)


def all_keys(run: str) -> list[str]:
    keys = RunKeys(run)
    return [
        keys.config,
        keys.insert("a"),
        keys.sample,
        keys.held_out,
        keys.progress,
        keys.weights,
        keys.latest_weights,
        keys.job("e"),
        keys.report("e"),
        keys.live("actor", "a"),
        keys.stats("actor", "a"),
    ]


def test_the_name_in_a_key_is_that_of_who_speaks() -> None:
    keys = RunKeys("r")
    named = (keys.insert, keys.job, keys.report)
    told = (keys.live, keys.stats, keys.view)
    spoken = [*(key("a.b") for key in named), *(key("actor", "a.b") for key in told)]
    assert {name_in(key) for key in spoken} == {"a.b"}


@pytest.mark.parametrize("name", ["", "-a", "a" * 65, "*", "a b", "a\n"])
def test_a_name_in_a_key_that_no_process_can_have_is_refused(name: str) -> None:
    with pytest.raises(MessageError, match="no process can have"):
        name_in(f"ale-robot/r/insert/{name}")


def test_every_key_of_a_run_is_its_own() -> None:
    keys = [zenoh.KeyExpr(key) for key in all_keys("r") + all_keys("s")]
    for i, one in enumerate(keys):
        assert zenoh.KeyExpr("ale-robot/*/**").includes(one)
        for other in keys[:i]:
            assert not one.intersects(other)


def test_a_star_stands_for_every_actor_and_run() -> None:
    keys = RunKeys("r")
    served = zenoh.KeyExpr(keys.insert("*"))
    assert served.includes(zenoh.KeyExpr(keys.insert("a")))
    assert not served.intersects(zenoh.KeyExpr(RunKeys("s").insert("a")))
    anywhere = zenoh.KeyExpr(RunKeys("*").config)
    assert [key for key in all_keys("r") if anywhere.intersects(zenoh.KeyExpr(key))] == [
        keys.config
    ]

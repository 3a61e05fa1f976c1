"""A recording: what an actor would have sent, or a sentence that says why not."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from common.dataset.layout import DATA_PATH, file_of
from common.errors import InputError
from common.protocol.chunk import Chunk
from common.protocol.run_keys import DEMONSTRATIONS
from common.registry import ENVIRONMENTS, Environment
from common.settings.config import RunConfig
from learner.demonstrations.recording import Demonstrations
from tests.actors.numbered_env import CUT, GAME_OVER, GOES_ON, LOSES_A_LIFE, Moment
from tests.extending.whole_run import added
from tests.recordings import CONFIG, SCRIPT, WITH_VECTOR, record, run_config

ENDINGS = st.sampled_from([GOES_ON] * 6 + [LOSES_A_LIFE, GAME_OVER, CUT])


def chunks_of(path: Path, config: RunConfig) -> list[Chunk]:
    """The chunks as the replay gets them."""
    made = Demonstrations(path, config).chunks("run")
    return [Chunk.decode(chunk.encode()) for chunk in made]


def expected(moments: list[Moment]) -> list[tuple[Moment, Moment | None]]:
    """Each step that the replay should get; a truncated one with the moment of its last state.

    What followed the last step of a game that was cut is not recorded.
    """
    ends = [*(moment.ending for moment in moments[:-1]), moments[-1].ending]
    if ends[-1] == GOES_ON:
        ends[-1] = CUT  # where the recording stopped
    found: list[tuple[Moment, Moment | None]] = []
    for moment, end, after, after_end in zip(
        moments, ends, [*moments[1:], None], [*ends[1:], ""], strict=True
    ):
        if end == CUT:
            continue
        cut = after if end == GOES_ON and after_end == CUT else None
        found.append((moment, cut))
    return found


@settings(max_examples=25)
@given(
    script=st.lists(ENDINGS, min_size=1, max_size=20),
    steps=st.integers(1, 50),
    length=st.integers(1, 9),
    vector=st.booleans(),
)
def test_the_replay_gets_what_the_network_saw_and_did(
    script: list[str], steps: int, length: int, vector: bool
) -> None:
    config = run_config(WITH_VECTOR if vector else CONFIG, length=length)
    with tempfile.TemporaryDirectory() as folder:
        moments = record(Path(folder) / "d", script, steps, config).moments
        assume(expected(moments))
        chunks = chunks_of(Path(folder) / "d", config)

    wanted = iter(expected(moments))
    for number, chunk in enumerate(chunks):
        assert (chunk.actor, chunk.sequence, chunk.games) == (DEMONSTRATIONS, number, ())
        episode, finals = list(chunk.context), 0
        for at in range(len(chunk)):
            moment, cut = next(wanted)
            if moment.begins:
                assert at or not episode  # no frame is that of another episode
                episode = []
            episode.append(chunk.frames[at])
            older = max(4 - len(episode), 0)
            state = [episode[0]] * older + episode[-4:]
            assert np.array_equal(np.stack(state), moment.state)
            assert np.array_equal(chunk.vectors[at], moment.vector)
            assert (chunk.actions[at], chunk.rewards[at]) == (moment.action, moment.reward)
            assert chunk.terminated[at] == (moment.ending in (LOSES_A_LIFE, GAME_OVER))
            assert chunk.truncated[at] == (cut is not None)
            assert chunk.valid[at] == moment.valid
            assert chunk.elapsed[at] == moment.info["elapsed"]
            assert chunk.follows[at] == moment.info["frame_follows"]
            assert chunk.matched[at] == moment.info["keys_match"]
            if cut is not None:
                assert np.array_equal(chunk.final_frames[finals], cut.state[-1])
                assert np.array_equal(chunk.final_vectors[finals], cut.vector)
                finals += 1
        assert finals == len(chunk.final_frames)
    assert next(wanted, None) is None


def test_a_recording_that_is_changed_while_it_is_read_is_refused(tmp_path: Path) -> None:
    record(tmp_path / "d", SCRIPT, 48)
    found = Demonstrations(tmp_path / "d", run_config())
    path = file_of(tmp_path / "d", DATA_PATH, 1)
    pq.write_table(pq.read_table(path), path, compression="gzip")
    with pytest.raises(InputError, match="was changed while it was read: begin a new run"):
        list(found.chunks("run"))


def test_a_recording_without_a_whole_step_is_refused(tmp_path: Path) -> None:
    record(tmp_path / "d", SCRIPT, 1)
    with pytest.raises(InputError, match="has no step to learn from: record whole games"):
        Demonstrations(tmp_path / "d", CONFIG)


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        (
            replace(CONFIG, game="breakout"),
            "pong instead of breakout: give the run --game pong, or",
        ),
        (replace(CONFIG, play=replace(CONFIG.play, frame_stack=3)), "play.frame_stack 4 instead"),
        (
            replace(CONFIG, play=replace(CONFIG.play, minimal_actions=False)),
            "play.minimal_actions True instead of False: give the run --play.minimal-actions, or",
        ),
        (WITH_VECTOR, "play.vector False instead of True: give the run --play.no-vector, or"),
        (
            replace(CONFIG, learning=replace(CONFIG.learning, clip_rewards=False)),
            "learning.clip_rewards True instead of False",
        ),
        (
            replace(CONFIG, learning=replace(CONFIG.learning, discount=0.5)),
            r"discounted with another --learning.discount: give the run 0.99, or",
        ),
        (run_config(capacity=47), "too many for the replay: raise --replay.capacity to 48 at"),
    ],
)
def test_other_settings_are_refused(tmp_path: Path, changed: RunConfig, reason: str) -> None:
    record(tmp_path / "d", SCRIPT, 48)
    with pytest.raises(InputError, match=reason):
        Demonstrations(tmp_path / "d", changed)


def test_those_of_another_environment_are_refused(tmp_path: Path) -> None:
    record(tmp_path / "d", SCRIPT, 48)
    other = Environment("lamps", "lamps:make", lambda _: CONFIG.action_count)
    with (
        added(ENVIRONMENTS, other),
        pytest.raises(InputError, match="game pong instead of lamps: give the run --env "),
    ):
        Demonstrations(tmp_path / "d", replace(CONFIG, env="lamps"))


def test_n_step_and_all_else_that_no_state_depends_on_may_differ(tmp_path: Path) -> None:
    record(tmp_path / "d", SCRIPT, 48)
    learning = replace(CONFIG.learning, n_step=7, learning_rate=1e-3)
    Demonstrations(tmp_path / "d", replace(CONFIG, seed=5, learning=learning))


def test_a_replay_has_room_for_all_of_them_or_they_are_refused(tmp_path: Path) -> None:
    """A game that was cut also takes a slot for its last frame."""
    record(tmp_path / "d", [*[GOES_ON] * 4, CUT], 50)
    with pytest.raises(InputError, match=r"has 40 steps, too many .* --replay.capacity to 50 at"):
        Demonstrations(tmp_path / "d", run_config(capacity=49))
    assert Demonstrations(tmp_path / "d", run_config(capacity=50)).stats.steps == 40


def test_two_recordings_are_two_incarnations_of_their_sender(tmp_path: Path) -> None:
    for name, steps in (("a", 48), ("b", 32), ("c", 48)):
        record(tmp_path / name, SCRIPT, steps)
    found = [Demonstrations(tmp_path / name, CONFIG).stats.incarnation for name in "abc"]
    assert found[0] == found[2] != found[1]

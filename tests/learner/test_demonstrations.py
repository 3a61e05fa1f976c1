"""Demonstrations: what an actor would have sent, once, or a sentence that says why not."""

import errno
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from common.dataset.layout import DATA_PATH, file_of
from common.errors import InputError
from common.protocol.chunk import Chunk
from common.protocol.run_keys import DEMONSTRATIONS, RunKeys
from common.registry import ENVIRONMENTS, Environment
from common.run.folder import RunFolder
from common.settings.config import RunConfig
from learner import demonstrations
from learner.demonstrations import Demonstrations, DemonstrationsRecord, begin_with, insert_all
from replay.replay_buffer import ReplayBuffer
from replay.server import ReplayServer
from tests.actors.numbered_env import CUT, GAME_OVER, GOES_ON, LOSES_A_LIFE, Moment
from tests.extending.whole_run import added
from tests.in_process_transport import InProcessHub, InProcessTransport
from tests.recordings import CONFIG, WITH_VECTOR, record

ENDINGS = st.sampled_from([GOES_ON] * 6 + [LOSES_A_LIFE, GAME_OVER, CUT])
SCRIPT = [*[GOES_ON] * 9, LOSES_A_LIFE, *[GOES_ON] * 5, GAME_OVER]


def run_config(config: RunConfig = CONFIG, *, capacity: int = 2_000, length: int = 8) -> RunConfig:
    return replace(
        config,
        replay=replace(config.replay, capacity=capacity, learning_starts=100),
        learning=replace(config.learning, batch_size=32),
        stream=replace(config.stream, chunk_steps=length),
    )


def chunks_of(path: Path, config: RunConfig) -> list[Chunk]:
    """The chunks as the replay gets them."""
    made = Demonstrations(path, config)._chunks("run", 7)
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


@contextmanager
def replay(folder: Path, config: RunConfig) -> Iterator[tuple[ReplayBuffer, InProcessTransport]]:
    hub = InProcessHub()
    buffer = ReplayBuffer(config, folder)
    with hub.connect() as transport, ReplayServer(transport, buffer, config, "r"):
        yield buffer, transport
    buffer.close()


def send(found: Demonstrations, buffer: ReplayBuffer, transport: InProcessTransport) -> list[str]:
    told: list[str] = []
    keys = RunKeys("r", buffer.run_id)
    sent = found.insert(transport, keys, threading.Event(), told.append)
    assert sent == replace(found.begun, complete=True)
    return told


def test_the_replay_takes_them_once_however_often_they_are_sent(tmp_path: Path) -> None:
    config = run_config()
    record(tmp_path / "d", SCRIPT, 48)
    with replay(tmp_path / "replay", config) as (buffer, transport):
        found = Demonstrations(tmp_path / "d", config)
        assert "48 steps" in send(found, buffer, transport)[0]
        send(found, buffer, transport)
        progress = buffer.progress(0)
        assert (progress.agent_steps, progress.stored, progress.refused) == (48, 48, 0)
        assert progress.duplicates == progress.accepted == 3 * (2 + 1)
        assert {each.actor for each in progress.statistics} == {DEMONSTRATIONS}
        # n-step returns reach to the ends of episodes, so that each step can be drawn.
        assert progress.samplable == 48
    with replay(tmp_path / "replay", config) as (buffer, transport):  # another process
        send(Demonstrations(tmp_path / "d", config), buffer, transport)
        assert buffer.progress(0).agent_steps == 48


def test_they_are_on_the_disk_before_they_count_as_sent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = run_config()
    record(tmp_path / "d", SCRIPT, 48)
    folder = RunFolder(tmp_path, "r")
    folder.path.mkdir()
    found, stop = Demonstrations(tmp_path / "d", config), threading.Event()
    with replay(tmp_path / "replay", config) as (buffer, transport):

        def fail() -> None:
            raise OSError(errno.EIO, os.strerror(errno.EIO))

        with monkeypatch.context() as power_fails:
            power_fails.setattr(buffer, "sync", fail)
            with pytest.raises(OSError, match="Input/output"):
                insert_all(found, transport, buffer, folder, stop, print)
        assert not folder.demonstrations.exists()
        assert insert_all(found, transport, buffer, folder, stop, print)
        begun = DemonstrationsRecord.of(folder)
        assert begun is not None
        assert begun.complete
        stop.set()
        assert not insert_all(found, transport, buffer, folder, stop, print)


def test_a_stop_ends_the_sending_and_a_replay_of_another_run_refuses(tmp_path: Path) -> None:
    config = run_config()
    record(tmp_path / "d", SCRIPT, 48)
    found = Demonstrations(tmp_path / "d", config)
    stop = threading.Event()
    stop.set()
    with replay(tmp_path / "replay", config) as (buffer, transport):
        assert not found.insert(transport, RunKeys("r", buffer.run_id), stop, print)
        with pytest.raises(InputError, match="it serves another run"):
            found.insert(transport, RunKeys("r", "another"), threading.Event(), print)
        assert 1 <= buffer.progress(0).refused <= config.stream.window


def test_a_malformed_reply_to_a_demonstration_is_told(tmp_path: Path) -> None:
    record(tmp_path / "d", SCRIPT, 48)
    found = Demonstrations(tmp_path / "d", run_config())
    hub = InProcessHub()
    with hub.connect() as server, hub.connect() as client:
        server.serve(RunKeys("r").insert("*"), lambda _: b"garbage")
        with pytest.raises(InputError, match=r"^the replay refused a demonstration: "):
            found.insert(client, RunKeys("r", "run"), threading.Event(), print)


def test_a_recording_that_is_changed_while_it_is_read_is_refused(tmp_path: Path) -> None:
    config = run_config()
    record(tmp_path / "d", SCRIPT, 48)
    found = Demonstrations(tmp_path / "d", config)
    path = file_of(tmp_path / "d", DATA_PATH, 1)
    pq.write_table(pq.read_table(path), path, compression="gzip")
    with (
        replay(tmp_path / "replay", config) as (buffer, transport),
        pytest.raises(InputError, match="was changed while it was read: begin a new run"),
    ):
        send(found, buffer, transport)


def test_a_replay_that_does_not_answer_is_waited_for_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demonstrations, "_PATIENCE", 2)
    record(tmp_path / "d", SCRIPT, 48)
    found = Demonstrations(tmp_path / "d", run_config())
    stop = threading.Event()
    told: list[str] = []

    def tell(text: str) -> None:
        told.append(text)
        stop.set()

    nobody = InProcessTransport(InProcessHub())
    assert not found.insert(nobody, RunKeys("r", "run"), stop, tell)
    assert told == ["the replay does not answer; the demonstrations wait for it."]


def test_a_recording_without_a_whole_step_is_refused(tmp_path: Path) -> None:
    record(tmp_path / "d", SCRIPT, 1)
    with pytest.raises(InputError, match="has no step to learn from: record whole games"):
        Demonstrations(tmp_path / "d", CONFIG)


def test_a_long_path_is_a_path(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path, "r")
    folder.path.mkdir()
    begun = DemonstrationsRecord("/" + "a/" * 1_000, "0" * 64, 5)
    folder.demonstrations.write_bytes(begun.encode())
    assert DemonstrationsRecord.of(folder) == begun


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
        (run_config(capacity=40), "too many for the replay: raise --replay.capacity"),
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


def test_a_run_begins_with_one_recording_and_goes_on_where_that_was_interrupted(
    tmp_path: Path,
) -> None:
    for name, steps in (("d", 48), ("other", 32)):
        record(tmp_path / name, SCRIPT, steps)
    folder = RunFolder(tmp_path, "r")
    folder.path.mkdir()

    def begun(given: str | None, *, resume: bool) -> Any:
        path = None if given is None else tmp_path / given
        found = begin_with(path, CONFIG, folder, resume=resume)
        return None if found is None else found.begun.steps

    assert begun(None, resume=False) is None
    assert begun("d", resume=False) == 48
    first = Demonstrations(tmp_path / "d", CONFIG).begun
    folder.demonstrations.write_bytes(first.encode())
    assert DemonstrationsRecord.of(folder) == first
    # Killed before all were sent: with the flag or without it.
    assert begun("d", resume=True) == begun(None, resume=True) == 48
    folder.demonstrations.write_bytes(replace(first, complete=True).encode())
    assert begun("d", resume=True) is begun(None, resume=True) is None
    (tmp_path / "d").rename(tmp_path / "moved")
    assert begun("d", resume=True) is None  # it is not even read
    assert begun("moved", resume=True) is None  # the same by its content
    (tmp_path / "moved").rename(tmp_path / "d")
    with pytest.raises(InputError, match=r"did not begin with the demonstrations .* omit --demo"):
        begun("other", resume=True)
    folder.demonstrations.unlink()
    for told in (folder.checkpoint, folder.previous, folder.epochs):
        told.touch()
        with pytest.raises(InputError, match="did not begin with"):
            begun("d", resume=True)
        told.unlink()
    folder.demonstrations.write_text("{}")
    with pytest.raises(InputError, match=r"demonstrations.json is damaged .*: repair or"):
        begun(None, resume=True)

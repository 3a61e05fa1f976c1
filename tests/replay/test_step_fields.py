"""A field of a step is declared once, and comes from the actor's chunk to the minibatch."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
from numpy.typing import NDArray

from common.errors import MessageError
from common.protocol.chunk import Chunk
from common.protocol.step_fields import STEP_FIELDS, Column, Flag, StepField, bit_of, step_fields
from replay.batch import SharedBatch
from replay.replay_buffer import ReplayBuffer
from replay.ring import STEP
from tests.replay import replay_reference
from tests.replay.replay_reference import GOES_ON, TERMINATES, TRUNCATES, Actor, make_config

FLAG, PAIR = Flag(32, drawn=True), Column(2, drawn=True, most=1e9)


@dataclass(frozen=True)
class ToyChunk(Chunk):
    """A chunk of steps with two more fields."""

    lucky: Annotated[NDArray[np.bool_], FLAG] = None  # type: ignore[assignment]
    pair: Annotated[NDArray[np.float32], PAIR] = None  # type: ignore[assignment]


@pytest.fixture
def toy_fields(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("lucky", "pair"):
        monkeypatch.setitem(STEP_FIELDS, name, step_fields(ToyChunk)[name])
    monkeypatch.setattr(replay_reference, "Chunk", ToyChunk)


def toy_chunk(actor: Actor, endings: list[int]) -> ToyChunk:
    """A chunk whose new fields follow from its actions."""
    chunk = actor.live(endings, np.random.default_rng(len(endings)))
    pair = np.stack([chunk.actions + 0.5, -chunk.actions.astype(np.float32)], axis=1)
    assert isinstance(chunk, ToyChunk)
    return replace(chunk, lucky=chunk.actions % 2 == 1, pair=pair.astype(np.float32))


@pytest.mark.usefixtures("toy_fields")
def test_a_new_field_comes_from_the_chunk_to_the_minibatch(tmp_path: Path) -> None:
    buffer, actor = ReplayBuffer(make_config(), tmp_path), Actor("a", 4)
    for endings in ([GOES_ON] * 9 + [TRUNCATES], [GOES_ON] * 4 + [TERMINATES] + [GOES_ON] * 5):
        sent = toy_chunk(actor, endings)
        assert buffer.insert(ToyChunk.decode(sent.encode())).status == "stored"
    shared = buffer.sample_shared(0, 0.0)
    assert shared is not None
    for batch in (buffer.sample(0, 0.0), SharedBatch.decode(shared.encode()).whole()):
        assert batch is not None
        assert set(batch.drawn) >= {"lucky", "pair"}
        assert batch.drawn["lucky"].dtype == np.bool_
        assert batch.drawn["pair"].dtype == np.float32
        assert (batch.drawn["lucky"] == (batch.a_tm1 % 2 == 1)).all()
        assert (batch.drawn["pair"][:, 0] == batch.a_tm1 + 0.5).all()
        assert (batch.drawn["pair"][:, 1] == -batch.a_tm1.astype(np.float32)).all()
    buffer.close()


@pytest.mark.usefixtures("toy_fields")
def test_a_new_field_is_found_again_after_a_restart(tmp_path: Path) -> None:
    config = make_config()
    buffer = ReplayBuffer(config, tmp_path)
    buffer.insert(toy_chunk(Actor("a", 4), [GOES_ON] * 12))
    buffer.close()
    buffer = ReplayBuffer(config, tmp_path)
    batch = buffer.sample(0, 0.0)
    assert batch is not None
    assert (batch.drawn["pair"][:, 0] == batch.a_tm1 + 0.5).all()
    buffer.close()


@pytest.mark.usefixtures("toy_fields")
def test_a_new_field_is_checked_as_it_is_declared() -> None:
    good = toy_chunk(Actor("a", 4), [GOES_ON] * 3)
    for wrong in (
        {"lucky": np.full(3, 2, np.uint8).view(np.bool_)},
        {"lucky": np.zeros(2, np.bool_)},
        {"pair": np.zeros((3, 3), np.float32)},
        {"pair": np.zeros((3, 2), np.float64)},
        {"pair": np.full((3, 2), 1.1e9, np.float32)},
    ):
        with pytest.raises(MessageError, match=next(iter(wrong))):
            ToyChunk.decode(ToyChunk(**(vars(good) | wrong)).encode())


def test_a_minibatch_with_other_fields_than_declared_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    buffer = ReplayBuffer(make_config(), tmp_path)
    buffer.insert(Actor("a", 4).live([GOES_ON] * 9, np.random.default_rng(0)))
    shared = buffer.sample_shared(0, 0.0)
    assert shared is not None
    monkeypatch.setitem(STEP_FIELDS, "pair", StepField(np.dtype(np.float32), PAIR))
    with pytest.raises(MessageError, match=r"drawn should be the fields .*pair"):
        SharedBatch.decode(shared.encode())
    buffer.close()


def test_the_files_of_runs_on_disk_keep_their_names_types_and_bits(tmp_path: Path) -> None:
    buffer = ReplayBuffer(make_config(capacity=64), tmp_path)
    buffer.close()
    sizes = {path.name: path.stat().st_size for path in tmp_path.glob("*.bin")}
    assert sizes == {
        "frames.bin": 64 * 84 * 84,
        "actions.bin": 64,
        "rewards.bin": 64 * 4,
        "flags.bin": 64,
        "elapsed.bin": 64,
        "vectors.bin": 0,
        "priorities.bin": 0,
    }
    bits = {name: bit_of(name) for name in ("terminated", "truncated", "valid")}
    assert bits == {"terminated": 1, "truncated": 2, "valid": 4}
    assert STEP == 8


def test_no_two_flags_share_a_bit() -> None:
    bits = [field.array.bit for field in STEP_FIELDS.values() if isinstance(field.array, Flag)]
    bits.append(STEP)
    assert sum(bits) == np.bitwise_or.reduce(bits) < 256

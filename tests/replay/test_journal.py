from pathlib import Path

import pytest

from common.errors import InputError
from replay.journal import Entry, Journal
from replay.journal import read_journal as read


def read_journal(path: Path) -> list[Entry | None]:
    """The entries without their checksums."""
    return [entry and {k: v for k, v in entry.items() if k != "crc"} for entry in read(path)]


def test_what_was_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    journal = Journal(path, [{"kind": "a"}])
    journal.append({"kind": "b", "n": [1, 2]})
    assert read_journal(path) == [{"kind": "a"}, {"kind": "b", "n": [1, 2]}]
    assert journal.size == path.stat().st_size > 0


def test_there_is_nothing_before_the_first_start(tmp_path: Path) -> None:
    assert read_journal(tmp_path / "none.jsonl") == []


@pytest.mark.parametrize("cut", range(1, 12))
def test_a_torn_last_line_was_never_written(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "journal.jsonl"
    journal = Journal(path, [{"kind": "a"}])
    journal.append({"kind": "b"})
    path.write_bytes(path.read_bytes()[:-cut])
    assert read_journal(path) == [{"kind": "a"}]


@pytest.mark.parametrize("junk", [b"{]", b"7", b"\xff\x00", b"", b"[" * 100_000])
def test_a_damaged_line_of_a_former_journal_is_passed_over(tmp_path: Path, junk: bytes) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_bytes(b'{"kind":"a"}\n' + junk + b'\n{"kind":"b"}\n')
    assert read_journal(path) == [{"kind": "a"}, None, {"kind": "b"}]


def test_every_flipped_bit_is_noticed_and_costs_one_line(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    entries = [{"kind": "ring", "n": 1}, {"kind": "tail", "tail": 64}, {"kind": "tail", "tail": 9}]
    Journal(path, entries).close()
    whole = path.read_bytes()
    begin, end = (whole.index(b"\n", at) for at in (0, whole.index(b"\n") + 1))
    for place in range(begin + 1, end):
        for bit in range(8):
            spoiled = bytearray(whole)
            spoiled[place] ^= 1 << bit
            path.write_bytes(spoiled)
            first, *spoiled_ones, last = read_journal(path)
            assert (first, last) == (entries[0], entries[2])
            assert spoiled_ones in ([None], [None, None])  # cut in two by a new line


def test_rewriting_replaces_all_and_appending_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    journal = Journal(path, [{"n": n} for n in range(9)])
    journal.rewrite([{"n": 8}])
    journal.append({"n": 9})
    assert journal.size == path.stat().st_size
    journal.close()
    assert read_journal(path) == [{"n": 8}, {"n": 9}]
    assert [file.name for file in tmp_path.iterdir()] == ["journal.jsonl"]


def test_a_line_that_finds_no_space_leaves_no_trace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "journal.jsonl"
    journal = Journal(path, [{"n": 0}])
    import os

    whole = os.write

    def half(file: int, data: bytes) -> int:
        if len(data) < 8:
            raise OSError(28, "No space left on device")
        return whole(file, data[:-4])

    with monkeypatch.context() as patch:
        patch.setattr("replay.journal.os.write", half)
        with pytest.raises(OSError, match="No space"):
            journal.append({"kind": "lost"})

    def broken(file: int, size: int) -> None:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr("replay.journal.os.ftruncate", broken)
        with pytest.raises(OSError, match="Input/output"):  # rather than be joined to the torn line
            journal.append({"kind": "lost too"})
    journal.append({"n": 1})
    assert read_journal(path) == [{"n": 0}, {"n": 1}]


def test_a_rewrite_that_finds_no_space_leaves_the_journal_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "journal.jsonl"
    journal = Journal(path, [{"n": 0}, {"n": 1}])

    def full(file: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("common.atomic_file.os.fsync", full)
        with pytest.raises(OSError, match="No space"):
            journal.rewrite([{"n": 1}])
        with pytest.raises(InputError, match=r"cannot be written \(No space"):
            Journal(tmp_path / "other.jsonl", [])
    journal.append({"n": 2})
    assert read_journal(path) == [{"n": 0}, {"n": 1}, {"n": 2}]

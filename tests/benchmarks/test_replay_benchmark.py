"""`python -m benchmarks.replay` on small rings, and the chunks that it inserts."""

import json
import time
from pathlib import Path

import pytest

from benchmarks import replay, report
from benchmarks.synthetic import camera_chunks
from common.errors import InputError
from common.settings.config import RunConfig, StreamConfig


def run(*flags: str) -> None:
    report.run("replay", replay.Options, replay.measure, flags)


def test_figures_of_each_size(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    results, files = tmp_path / "replay.json", tmp_path / "files"
    files.mkdir()
    flags = ("--seconds", "0.05", "--folder", str(files), "--json", str(results))
    began = time.monotonic()
    run("--sizes", "512", "1024", *flags)
    lasted = time.monotonic() - began
    found = json.loads(results.read_text())
    assert [each["capacity"] for each in found["sizes"]] == [512, 1_024]
    for each in found["sizes"]:
        capacity = each["capacity"]
        # Full but for what a chunk does not fit into, and the first chunks' missing neighbours.
        assert capacity - 2 * 64 <= each["stored"] <= capacity
        assert capacity * 7_056 < each["file_bytes"] < capacity * 7_200 + 50_000
        assert each["private_bytes"] > 1e6
        # However slow the machine: at least one chunk or batch, in less time than all took.
        assert each["insert_steps_per_second"] * lasted > 64
        assert each["uniform_batches_per_second"] * lasted > 1
        assert each["prioritised_batches_per_second"] * lasted > 1
    assert [row["steps"] for row in found["rows"]] == [each["stored"] for each in found["sizes"]]
    assert found["versions"]["numpy"]
    assert not list(files.iterdir())
    assert "prioritised" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (["--sizes", "100"], "sizes"),
        (["--seconds", "0"], "seconds"),
        (["--folder", "/dev/null/folder"], "cannot be written"),
    ],
)
def test_settings_that_cannot_work(flags: list[str], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        run(*flags)


def test_chunks_of_camera_frames_are_chunks_and_compress() -> None:
    made = camera_chunks("r", ("a", "b"), RunConfig(stream=StreamConfig(chunk_steps=8)))
    chunks = [next(made) for _ in range(5)]
    assert [(each.actor, each.sequence) for each in chunks] == [
        ("a", 0),
        ("b", 0),
        ("a", 1),
        ("b", 1),
        ("a", 2),
    ]
    assert all(len(each) == 8 and len(each.context) == 3 for each in chunks)
    assert all(len(each.encode()) < each.frames.nbytes / 5 for each in chunks)

"""Whatever strangers send is refused or taken, and the run goes on: nothing else is raised."""

import contextlib
import importlib.util
import json
import random
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from common.process.footprint import footprint
from tests.fuzz.mutation import mutate
from tests.fuzz.targets import REFUSED, Target, Targets
from tests.paths import ROOT

NAMES = (
    "insert", "sample", "held_out", "progress", "job", "report", "view", "stats",
    "version", "weights", "ack", "announcement", "batch", "held_out_states", "progress_told",
    "job", "live_view", "run_status", "signature", "seal",
)  # fmt: skip
_A_FEW = 300
_MAX_BYTES = 64 * 2**20


@pytest.fixture(scope="module")
def targets(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Targets]:
    with Targets(tmp_path_factory.mktemp("fuzz")) as found:
        yield found


def test_every_target_has_a_name_here(targets: Targets) -> None:
    assert set(NAMES) == set(targets.all)
    served = {*targets.transport.answers, *targets.transport.callbacks}
    assert {key.split("/")[2] for key in served} == {
        *("config", "insert", "latest_weights", "sample", "held_out", "progress"),
        *("job", "report", "view", "stats", "weights"),
    }, "a new key expression needs a target"


@pytest.mark.parametrize("name", NAMES)
def test_what_the_program_writes_is_taken(targets: Targets, name: str) -> None:
    target = targets.all[name]
    for seed in target.seeds:
        with contextlib.suppress(*(REFUSED if target.seldom else ())):
            target.take(seed)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_nearly_right_is_taken_or_refused(targets: Targets, name: str) -> None:
    chance, target = random.Random(name), targets.all[name]
    before, refused = footprint().private, 0
    for _ in range(_A_FEW):
        refused += _is_refused(target, mutate(chance.choice(target.seeds), chance))
    assert refused > 0 or name in ("stats", "version"), "nothing was wrong with any of them"
    assert footprint().private - before < _MAX_BYTES


def _is_refused(target: Target, message: bytes) -> bool:
    try:
        target.take(message)
    except REFUSED:
        return True
    return False


def test_afterwards_all_works_as_before(targets: Targets) -> None:
    """What got through has not broken what is kept."""
    progress = targets.replay.progress(0)
    assert progress.agent_steps >= 6
    assert targets.replay.sample_shared(0, 0.0) is not None
    assert len(json.dumps(targets.registry.state())) < 2**20
    targets.replay.sync()


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("atheris") is None, reason="atheris is not installed: .[fuzz]"
)
@pytest.mark.parametrize("name", NAMES)
def test_a_hundred_thousand_messages_guided_by_coverage(name: str, tmp_path: Path) -> None:
    words = [sys.executable, "-m", "tests.fuzz", name, "--messages", "100000"]
    ended = subprocess.run(
        words, cwd=tmp_path, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr[-4_000:]
    done = re.search(r"number_of_executed_units: (\d+)", ended.stderr)
    assert done is not None, ended.stderr[-4_000:]
    assert int(done[1]) >= 100_000

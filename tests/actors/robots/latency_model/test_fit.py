"""Learning a latency model: by models whose function is known."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from actors.robots.latency_model import fit
from actors.robots.latency_model.fit import commands, differing, record
from actors.robots.latency_model.model import LatencyModel
from actors.robots.latency_model.recording import Recording, inputs
from actors.robots.latency_model.weights import ModelWeights, read_copies
from common.errors import InputError
from tests.actors.robots.latency_model.models import Arrays, delay, drawn, flicker, saved

PONG = (0, 1, 3, 4, 11, 12)


@pytest.fixture(autouse=True)
def _few_updates(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fit, "UPDATES", 1_000)
    monkeypatch.setattr(fit, "_BATCH", 256)


def recorded(arrays: Arrays, steps: int, seed: int = 0) -> Recording:
    rng = np.random.default_rng(seed)
    model = LatencyModel([ModelWeights(**arrays)], 60)  # type: ignore[arg-type]
    return record(model, commands(PONG, steps, rng))


@pytest.mark.parametrize("seed", range(3))
def test_the_inputs_are_those_by_which_a_model_takes_its_actions(seed: int) -> None:
    arrays = drawn(7, seed)
    found = recorded(arrays, 60, seed)
    columns = inputs(found)
    assert columns.shape == (240, 60)
    hidden = arrays["fc_weight"].T[columns].sum(axis=1, dtype=np.float64) + arrays["fc_bias"]
    values = np.maximum(hidden, 0) @ arrays["pred_weight"].T + arrays["pred_bias"]
    assert values.argmax(axis=1).tolist() == found.held.tolist()
    assert len(set(found.held.tolist())) > 3


def test_a_recording_has_each_command_for_the_frames_of_an_agent_step() -> None:
    found = recorded(delay(2), 50)
    assert (found.wanted.reshape(50, 4) == found.wanted[::4, None]).all()
    assert found.held.tolist() == [0, 0, *found.wanted[:-2].tolist()]


def test_commands_are_short_and_shorter_in_the_first_half() -> None:
    told = list(commands(PONG, 8_000, np.random.default_rng(0)))
    assert len(told) == 8_000
    assert set(told) == set(PONG)
    changes = np.diff(told) != 0
    # Of so many new commands five sixths are of another action.
    for half, mean in enumerate((1, 2)):
        share = changes[half * 4_000 : (half + 1) * 4_000].mean()
        assert share == pytest.approx(5 / 6 / mean, rel=0.2)


@pytest.mark.parametrize("arrays", [delay(0), delay(7), flicker()], ids=["now", "late", "flicker"])
def test_hands_of_a_known_function_are_learned(arrays: Arrays) -> None:
    told: list[int] = []
    weights = fit.fit([recorded(arrays, 4_000)], hidden=32, seed=0, tell=told.append)
    assert told == list(range(1, 1_001))
    assert differing(weights, recorded(arrays, 200, seed=1)) < 0.01


def test_what_differs_is_counted_while_the_model_runs_by_itself() -> None:
    late = ModelWeights(**delay(4))  # type: ignore[arg-type]
    found = recorded(delay(3), 100)
    assert differing(late, recorded(delay(4), 100)) == 0
    assert differing(late, found) == np.mean(np.diff(found.held, prepend=0) != 0)


def test_the_command_writes_a_model_and_tells_how_good_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, file = saved(tmp_path / "arm.npz", delay(5)), tmp_path / "new" / "model.npz"
    arguments = ["--robot", robot, "--play.robot-settings", "rate=60", "--steps", "300"]
    monkeypatch.setattr(sys, "argv", ["fit", "-o", str(file), *arguments, "--hidden", "16"])
    fit.main()
    (weights,) = read_copies(str(file))
    assert weights.fc_weight.shape == (16, 1080)
    told = capsys.readouterr().out
    assert told.startswith(f"wrote {file}: in 120 other frames with ")
    assert told.endswith(f"\nplay by it: --robot {file} --play.robot-settings rate=60\n")
    share = differing(weights, recorded(delay(5), 300))
    assert share < 0.05
    assert "%.\n" in told


def test_several_copies_of_the_same_hands_are_written_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, file = saved(tmp_path / "arm.npz", delay(5)), tmp_path / "model.npz"
    arguments = ["--robot", robot, "--play.robot-settings", "rate=60", "--steps", "300"]
    arguments += ["--hidden", "8", "--copies", "2", "--seed", "3"]
    monkeypatch.setattr(sys, "argv", ["fit", "-o", str(file), *arguments])
    fit.main()
    told = capsys.readouterr().out
    first, second = read_copies(str(file))
    assert (first.fc_weight != second.fc_weight).any()
    assert re.search(r"in \d+\.\d\d%, \d+\.\d\d%\.\n", told)
    # The first is as if it were alone.
    monkeypatch.setattr(sys, "argv", ["fit", "-o", str(file), *arguments, "--copies", "1"])
    fit.main()
    (alone,) = read_copies(str(file))
    assert (alone.fc_weight == first.fc_weight).all()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--game", "pinball"], "pinball"),
        (["--robot", "nobody"], "there is no robot 'nobody'"),
        (["--robot", "nao", "--play.robot-settings", "a=1"], "nao has no settings of its own"),
        (["--hidden", "0"], "hidden"),
        (["--copies", "17"], "copies"),
    ],
)
def test_what_cannot_be_measured_is_refused_and_leaves_no_file(
    arguments: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "model.npz"
    monkeypatch.setattr(sys, "argv", ["fit", "-o", str(file), *arguments])
    with pytest.raises(InputError, match=words):
        fit.main()
    assert not file.exists()

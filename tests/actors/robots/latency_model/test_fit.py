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
from actors.robots.latency_model.weights import MAX_UNITS, ModelWeights, read_copies, write_copies
from common.errors import InputError
from tests.actors.robots.latency_model.models import Arrays, delay, drawn, flicker, saved, together

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
    assert "%.\nthat is no copy of these hands yet, or its test is too short: give more" in told


def fitted(
    monkeypatch: pytest.MonkeyPatch, folder: Path, *arguments: str
) -> tuple[list[ModelWeights], list[tuple[int, list[int]]]]:
    """The copies that the command writes, and the seed and commands that each learned from."""
    seen = []

    def learn(recordings: list[Recording], hidden: int, seed: int, tell: object) -> ModelWeights:
        seen.append((seed, recordings[-1].wanted.tolist()))
        return ModelWeights(**delay(4 + len(seen)))  # type: ignore[arg-type]

    monkeypatch.setattr(fit, "fit", learn)
    robot, file = saved(folder / "arm.npz", delay(5)), folder / "model.npz"
    hands = ["--robot", robot, "--play.robot-settings", "rate=60"]
    monkeypatch.setattr(sys, "argv", ["fit", "-o", str(file), *hands, *arguments])
    fit.main()
    return read_copies(str(file)), seen


def test_several_copies_of_the_same_hands_are_written_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    copies, seen = fitted(monkeypatch, tmp_path, "--steps", "90", "--copies", "3", "--seed", "3")
    for copy, late in zip(copies, (5, 6, 7), strict=True):
        assert (copy.fc_weight == delay(late)["fc_weight"]).all()
    assert [seed for seed, _ in seen] == [3, 4, 5]
    assert all(commands == seen[0][1] for _, commands in seen)
    # The first copy is the hands; the others hold every change a frame and two frames later.
    told = re.search(
        r"in 36 other frames with (\d+) changes of keys, .* in 0\.00 %, (\S+) %, (\S+) %\.\n",
        capsys.readouterr().out,
    )
    assert told is not None
    changes, one_late, two_late = map(float, told.groups())
    assert one_late == pytest.approx(100 * changes / 36, abs=0.01)
    assert two_late > one_late
    _, others = fitted(monkeypatch, tmp_path, "--steps", "90", "--seed", "4")
    assert others[0][1] != seen[0][1]


@pytest.mark.parametrize(
    ("changes", "wrong", "told"), [(199, 0.0, True), (200, 0.1, False), (900, 0.11, True)]
)
def test_a_poor_copy_and_a_short_test_are_told(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    changes: int,
    wrong: float,
    told: bool,
) -> None:
    held = np.cumsum(np.arange(2_000) < changes + 1) % 2
    monkeypatch.setattr(fit, "record", lambda *given: Recording(held, held))
    monkeypatch.setattr(fit, "differing", lambda *given: wrong)
    fitted(monkeypatch, tmp_path, "--steps", "9")
    said = capsys.readouterr().out
    assert f"with {changes} changes of keys" in said
    assert ("give more --steps" in said) == told


def test_a_few_steps_have_a_test_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fitted(monkeypatch, tmp_path, "--steps", "3")
    assert "in 4 other frames" in capsys.readouterr().out


def test_of_several_copies_none_is_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = saved(tmp_path / "arm.npz", together(delay(5), delay(6)))
    monkeypatch.setattr(sys, "argv", ["fit", "-o", str(tmp_path / "m.npz"), "--robot", robot])
    with pytest.raises(
        InputError, match=r"arm\.npz holds 2 copies of the hands where one is needed"
    ):
        fit.main()


def test_the_largest_file_that_is_written_can_be_read(tmp_path: Path) -> None:
    copies = [ModelWeights(**drawn(MAX_UNITS // 4, 0))] * 4  # type: ignore[arg-type]
    write_copies(tmp_path / "m.npz", copies)
    assert len(read_copies(str(tmp_path / "m.npz"))) == 4


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--game", "pinball"], "pinball"),
        (["--robot", "nobody"], "there is no robot 'nobody'"),
        (["--robot", "nao", "--play.robot-settings", "a=1"], "nao has no settings of its own"),
        (["--hidden", "0"], "hidden"),
        (["--copies", "17"], "copies"),
        (["--copies", "0"], "copies"),
        (["--copies", "4", "--hidden", "4000"], "choose at most 3,816 of them"),
        (["-o", "hands"], "hands is no .npz file"),
        (["--seed", f"{2**63}"], "seed"),
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

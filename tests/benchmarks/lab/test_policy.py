"""How experiments train: what a training leaves, and what it leaves when it was stopped."""

import json
import shlex
import sys
from pathlib import Path

import pytest

from benchmarks.lab import policy
from common.command_line.run_options import parse_run
from common.errors import InputError
from common.run.folder import RunFolder
from learner.options import LearnerOptions, stored_config


@pytest.mark.parametrize("done", [30_000, 29_999])
def test_a_training_that_was_stopped_is_not_evaluated(
    done: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = RunFolder(tmp_path, "r")
    folder.path.mkdir()

    def learner(module: str, *arguments: str, env: dict[str, str]) -> None:
        assert (module, arguments[arguments.index("--steps") + 1]) == ("learner", "30000")
        # Whoever reads the learner's last line goes on with the experiment.
        assert env["ALE_ROBOT_EXPERIMENT"] == shlex.join(["python", *sys.orig_argv[1:]])
        folder.summary.write_text(json.dumps({"agent_steps": done}))

    monkeypatch.setattr(policy, "run_module", learner)
    if done == 30_000:
        assert policy.train(folder, done, ["--env", "ale"]) == {"agent_steps": done}
    else:
        with pytest.raises(InputError, match="r was stopped after 29,999 of 30,000 agent steps"):
            policy.train(folder, 30_000, ["--env", "ale"])


def test_a_run_that_was_trained_for_longer_is_not_taken_for_a_shorter_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two experiments of other budgets give their runs the same names."""
    folder = RunFolder(tmp_path, "r")
    folder.path.mkdir()
    monkeypatch.delattr(policy, "run_module")  # one that is done is not begun again
    folder.summary.write_text('{"agent_steps": 102000}')  # as long as its actors played on
    assert policy.train(folder, 100_000, []) == {"agent_steps": 102_000}
    folder.summary.write_text('{"agent_steps": 300160}')
    with pytest.raises(InputError, match=r"r has 300,160 agent steps instead of 100,000"):
        policy.train(folder, 100_000, [])


def test_a_training_that_was_killed_before_its_first_checkpoint_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = RunFolder(tmp_path, "r")
    options: list[LearnerOptions] = []

    def learner(module: str, *arguments: str, **_: object) -> None:
        asked = parse_run(LearnerOptions, module, arguments, stored_config)
        asked.check_here()
        options.append(asked)
        folder.summary.parent.mkdir(exist_ok=True)
        folder.summary.write_text(json.dumps({"agent_steps": 30_000}))

    monkeypatch.setattr(policy, "run_module", learner)
    policy.train(folder, 30_000, ["--env", "ale"])
    folder.summary.unlink()
    folder.claim("learner", options[0].config, resume=False)
    folder.replay.mkdir()  # its ring was made, and then it was killed
    policy.train(folder, 30_000, ["--env", "ale"])
    assert [each.resume for each in options] == [False, True]


@pytest.mark.parametrize(
    ("flags", "why"),
    [
        (["--steps", "5"], r"--steps is 5, no more than the warm-up of 10,000"),
        (["--env", "foo"], "there is no environment 'foo'"),
        (["--stepss", "4"], "there is no flag --stepss: did you mean --steps"),
    ],
)
def test_what_a_learner_would_refuse_is_refused_in_one_sentence(
    flags: list[str], why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(policy, "run_module")
    with pytest.raises(InputError, match=f"python -m learner refuses to train: {why}"):
        policy.train(RunFolder(tmp_path, "r"), 30_000, ["--env", "ale", *flags])
    assert not any(tmp_path.iterdir())

"""What cannot be done is said in one sentence, with exit code 2, or 4 where nobody answers."""

import re
import socket
import time
from pathlib import Path

import pytest

from common.process.log_lines import LOADING
from tests.end_to_end.conftest import SMALL, Stage


def _sentence(output: str) -> str:
    *before, line = output.strip().splitlines()
    known = ("waiting ", "going on with run ", LOADING)
    assert all(each.startswith(known) for each in before)
    assert line.startswith("error: ")
    assert line[-1] in ".?"
    return line


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--env", "ale", "--game", "pomg"], "pong"),
        (["--env", "ale", "--replay.ratio-tolerance", "1"], "ratio-tolerance"),
        (
            ["--env", "ale", "--replay.capacity", "20000", "--replay.learning-starts", "30000"],
            "capacity",
        ),
        (["--preset", "papper"], "preset"),
        (["--env", "ale", "--resume"], "no run"),
        (["--env", "ale", "--steps", "150", *SMALL], "--steps"),
        (["--env", "ale", "--listen", "nowhere"], "address"),
        (["--env", "ale", "--device", "cuda"], "CUDA"),
        (["--env", "ale", "--replay.capacity", "2000000000"], "space"),
    ],
)
def test_the_learner_refuses(stage: Stage, arguments: list[str], words: str) -> None:
    import torch

    if words == "CUDA" and torch.cuda.is_available():
        pytest.skip("there is a CUDA device here")
    assert words in _sentence(stage.learner(*arguments).ends(2))


def test_a_learner_without_a_replay(stage: Stage) -> None:
    learner = stage.learner("--connect", "tcp/127.0.0.1:9", "--patience", "0.5")
    assert "no hub answered" in _sentence(learner.ends(4))


def test_a_port_that_is_taken(stage: Stage) -> None:
    with socket.create_server(("127.0.0.1", int(stage.endpoint.rsplit(":", 1)[1]))):
        sentence = _sentence(stage.learner("--env", "ale", *SMALL).ends(2))
    assert stage.endpoint in sentence


def test_a_replay_that_cannot_be_asked_at_its_address_leaves_nothing(stage: Stage) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        flags = ("--listen", stage.endpoint, "--http", f"127.0.0.1:{taken.getsockname()[1]}")
        replay = stage.start("-m", "replay", "--run=r", "--env=ale", *flags, *SMALL)
        assert "choose another address with --http" in _sentence(replay.ends(2))
    assert not stage.run.exists()


def test_an_actor_without_a_hub(stage: Stage) -> None:
    began = time.monotonic()
    sentence = _sentence(stage.actor("a", "--patience", "0.5").ends(4))
    lasted = time.monotonic() - began
    assert "no hub answered" in sentence
    # One try takes a second; it has no more to tell than what the process' whole life took.
    (waited,) = re.findall(r"in (\d+) s", sentence)
    assert 1 <= int(waited) <= lasted + 0.5


def test_resuming_with_other_settings_or_damaged_files(stage: Stage) -> None:
    stage.learner("--local", "--env", "ale", "--steps", "300", *SMALL).ends()
    checkpoint: Path = stage.run / "checkpoint.safetensors"

    other = _sentence(stage.learner("--resume", "--learning.n-step", "7").ends(2))
    assert "learning.n_step 5 → 7" in other
    fresh = _sentence(stage.learner("--env", "ale", *SMALL).ends(2))
    assert "--resume" in fresh
    (stage.run / "checkpoint.previous.safetensors").unlink()  # to which it would fall back
    whole = checkpoint.read_bytes()
    checkpoint.write_bytes(whole[: len(whole) // 2])
    assert "damaged" in _sentence(stage.learner("--resume").ends(2))
    spoilt = bytearray(whole)
    spoilt[len(spoilt) // 2] ^= 1
    checkpoint.write_bytes(spoilt)
    assert "damaged" in _sentence(stage.learner("--resume").ends(2))

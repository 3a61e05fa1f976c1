"""A robot whose camera shows nothing but noise: the run ends by itself, unless it is forced."""

import shlex
import signal

import pytest
from safetensors.numpy import load_file

from tests.end_to_end.conftest import SMALL, Stage

BLIND = ("--camera.noise=255", "--camera.blur=3")
"""Flags of a camera in whose pictures no screen can be found."""
SOON = ("--stream.chunk-steps=2", "--replay.learning-starts=100")
"""With 0.1 minutes, a health check may be red for 6 seconds and 320 steps."""


@pytest.mark.slow
def test_a_blind_robot_stops_and_goes_on_only_by_force(stage: Stage) -> None:
    own = {flag.partition("=")[0] for flag in SOON}
    small = [flag for flag in SMALL if flag.partition("=")[0] not in own]
    alone = ("--local", "--evaluators=0", "--gate-minutes=0.1")
    given = (*alone, "--env=robot", *small, *BLIND, *SOON)
    output = stage.learner(*given).ends(3)

    (last,) = (line for line in output.splitlines() if line.startswith("stopped: "))
    assert (
        "health check 'valid frames' has been red for 0.1 minutes and 320 steps: it is 0, " in last
    )
    assert "the screen is not found in the camera's picture" in last
    command = f"--run r --threads=1 {shlex.join(given)} --resume --force"
    assert output.rstrip().endswith(command)
    assert not stage.strays()
    stopped = stage.summary()
    assert stopped["agent_steps"] >= 100 + 320
    assert load_file(stage.run / "checkpoint.safetensors")

    assert "stopped: health check 'valid frames'" in stage.learner(*alone, "--resume").ends(3)
    resumed = stage.summary()
    assert resumed["agent_steps"] >= stopped["agent_steps"] + 320

    forced = stage.learner(*alone, "--resume", "--force")
    forced.says("WARNING: health check 'valid frames' has been red")
    forced.send(signal.SIGTERM)
    forced.ends()
    assert stage.summary()["agent_steps"] >= resumed["agent_steps"] + 320

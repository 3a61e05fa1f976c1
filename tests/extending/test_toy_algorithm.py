"""An algorithm that is registered from outside learns through the whole pipeline."""

import json

import numpy as np
from safetensors.numpy import load_file

from tests.end_to_end import catch
from tests.end_to_end.conftest import SMALL, Stage
from tests.extending import toy_algorithm


def test_a_toy_algorithm_learns_by_its_name(stage: Stage) -> None:
    learner = stage.start(
        toy_algorithm.__file__,
        *("--listen", stage.endpoint, "--run", "r", "--threads=1", "--env", "ale"),
        *("--learning.algorithm", "random_policy", "--steps", "900", *SMALL),
    )
    stage.start(catch.__file__, stage.endpoint, "a", "actor")

    learner.ends()

    assert stage.summary()["updates"] >= (900 - 600) // 4
    config = json.loads((stage.run / "config.json").read_text())
    assert config["learning"]["algorithm"] == "random_policy"
    state = load_file(stage.run / "checkpoint.safetensors")
    learned = state["online.actions.bias"] - state["target.actions.bias"]
    assert np.isfinite(learned).all()
    assert (learned != 0).any()

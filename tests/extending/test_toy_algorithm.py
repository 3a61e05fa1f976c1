"""An algorithm of an installed package learns through the whole pipeline, in every process."""

import json

import numpy as np
from safetensors.numpy import load_file

from benchmarks.entry_point import add_entry_point
from tests.end_to_end.conftest import SMALL, Stage


def test_a_toy_algorithm_learns_by_its_name(stage: Stage) -> None:
    place = "tests.extending.toy_algorithm:RANDOM_POLICY"
    add_entry_point(stage.folder, "toy-algorithm", "algorithm", "random_policy", place)
    learner = stage.learner(
        *("--env", "ale", "--learning.algorithm", "random_policy", "--steps", "300", *SMALL),
        *("--learning.algorithm-settings", "greed=0.5"),
    )
    stage.actor("a")

    learner.ends()

    assert stage.summary()["updates"] >= (300 - 200) // 4
    config = json.loads((stage.run / "config.json").read_text())
    assert config["learning"]["algorithm"] == "random_policy"
    assert config["learning"]["algorithm_settings"] == "greed=0.5"
    state = load_file(stage.run / "checkpoint.safetensors")
    learned = state["online.actions.bias"] - state["target.actions.bias"]
    assert np.isfinite(learned).all()
    assert (learned != 0).any()

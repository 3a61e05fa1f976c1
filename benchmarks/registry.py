"""The benchmarks of speed, with the flags that make the published tables; and the experiments.

To add a benchmark, write its module (see `benchmarks.report`) and name it here.
"""

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

RESULTS = Path(__file__).parent / "results"


@dataclass(frozen=True)
class Benchmark:
    """A module ``benchmarks.NAME``."""

    measures: str
    published: Mapping[str, str]
    """Flags, as in a shell, by the name of the result that they make: RESULT.json."""


_EIGHT_DRAWS = "--learning.batch-size 128 --learning.train-period 16 --learning.publish-period 12"
"""Settings by which a robot's steps are drawn eight times each, as in 2017; the preset draws each
four times."""

BENCHMARKS = {
    "learner_updates": Benchmark(
        "one Double DQN update: by threads and precision, by kind of work, exactness",
        {
            "learner_updates": "",
            "learner_updates_128": "--batch-size 128 --compared 0 --rounds 12 --preset",
        },
    ),
    "env_steps": Benchmark(
        "agent steps of environments on one core, and what one is made of",
        {"env_steps": "", "env_steps_beside": "--beside-learner"},
    ),
    "actor_steps": Benchmark(
        "agent steps of a whole actor on one core, with network, stream and statistics",
        {"actor_steps": ""},
    ),
    "replay": Benchmark(
        "inserts and minibatches of the replay in one process, and its memory", {"replay": ""}
    ),
    "transport": Benchmark(
        "chunks in and minibatches out of a replay process, over Zenoh",
        {"transport": "", "transport_uniform": "--sampler uniform"},
    ),
    "many_actors": Benchmark(
        "a hub with 1 to 1,024 actors in real time: what they get, what it costs, weights to all",
        {
            "many_actors": "",
            "many_actors_one_router": "--numbers 64 256",
            "many_actors_two_routers": "--numbers 64 256 --router",
        },
    ),
    "flood": Benchmark(
        "training beside one certified client that sends as much as it can, and what is refused",
        {"flood": ""},
    ),
    "epochs_per_day": Benchmark(
        "a whole local run: training, tests, and how many of the 2017 epochs a day has room for",
        {
            "epochs_ale": "--env ale",
            "epochs_robot": f'--env robot --learner="--envs 2 {_EIGHT_DRAWS}" --evaluators 2',
            "epochs_robot_async": "--env robot --no-sync --actors 10 --evaluators 5"
            ' --learner="--learning.batch-size 32 --learning.train-period 4"',
        },
    ),
    "scaling": Benchmark(
        "a whole local run with more and more actors",
        {"scaling": f'--env robot --learner="{_EIGHT_DRAWS}"'},
    ),
    "peers": Benchmark(
        "training, replay and update beside stable-baselines3, cpprb and plain PyTorch",
        {
            "peers": "",
            "peers_training": "--only training",
            "peers_training_again": "--only training",
        },
    ),
}
"""All benchmarks by name, in the order in which `make bench` runs them."""


def experiments() -> Mapping[str, str]:
    """Returns what each experiment, a module ``benchmarks.lab.NAME``, measures, by its name.

    The docstring of an experiment begins with its command and a colon.
    """
    told = {
        file.stem: ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
        for file in sorted((Path(__file__).parent / "lab").glob("[a-z]*.py"))
    }
    first = {name: text.partition("\n\n")[0].replace("\n", " ") for name, text in told.items()}
    return {
        name: text.partition("`: ")[2]
        for name, text in first.items()
        if text.startswith(f"`python -m benchmarks.lab.{name}")
    }

"""Local mode: actors and evaluators as supervised children of the learner."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from common.process.supervisor import Child, Supervisor


def launch(
    endpoint: str,
    run: str,
    actors: int,
    envs: int,
    evaluators: int,
    logs: Path,
    flags: Sequence[str],
    *,
    low_priority: bool,
) -> Supervisor:
    """Start the actors and evaluators of a run on this machine.

    Args:
        envs: environments in each actor.
        logs: folder for what they print.
        flags: for all of them: how time passes, such as ``["--sync"]``, and their certificates.
        low_priority: run them at a lower priority than this process. Not for robots in real
            time, whose deadlines do not wait.
    """
    logs.mkdir(parents=True, exist_ok=True)
    roles = {f"actor-{index}": ["--envs", str(envs)] for index in range(1, actors + 1)}
    roles |= {f"evaluator-{index}": ["--evaluator"] for index in range(1, evaluators + 1)}
    common = ("--connect", endpoint, "--run", run, *flags)
    return Supervisor(
        {
            name: partial(
                Child,
                *("actors", "--name", name, *common, *own),
                leash=True,
                low_priority=low_priority,
                log=logs / f"{name}.log",
            )
            for name, own in roles.items()
        }
    )

"""Ray: the processes of a run as children of Ray actors, which Ray places and starts again.

The Ray actors are detached, so the launcher may leave. To launch the run again changes how many
there are.
"""

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import ray
from ray.exceptions import ActorDiedError, GetTimeoutError, RayError

from common.errors import InputError
from common.process.lifeline import on_signals
from deploy.description import RunDescription
from deploy.ray_keepers import LEARNER, ActorKeeper, LearnerKeeper

_ANSWER = 30.0
"""Seconds to wait for an answer of a keeper; one that has none by then has no node yet."""
_LOOK = 1.0
_GIBIBYTE = 1024**3


def launch(run: RunDescription) -> str:
    """Has the cluster run as many processes as described, and returns what the user should know."""
    options, log = run.options, run.folder.logs / "learner.log"
    with _connected(options.address, run.folder.name):
        learner = _find(LEARNER)
        if options.stop:
            return _stop(run, learner)
        if learner is None:
            learner = _begin(run)
        elif run.flags:
            raise InputError(
                f"the run {run.folder.name} is under way: omit the flags after `--` to change the "
                "number of its processes, or end it first with --stop."
            )
        changed = _scale(run)
        told = (
            f"The learner is {_place(learner, run)}; {changed}. Follow it:\n  tail -F {log}\n"
            "End it, with a checkpoint:\n"
            f"  ale-robot launch ray --address {options.address} --run {run.folder.name} --stop"
        )
        if not options.wait:
            return told
        print(told, flush=True)
        return _wait(run, learner)


@contextmanager
def _connected(address: str, run: str) -> Iterator[None]:
    """A session with the cluster, in the namespace of ``run``."""
    try:
        ray.init(
            address, namespace=f"ale-robot-{run}", log_to_driver=False, logging_level=logging.ERROR
        )
    except (ConnectionError, RuntimeError, ValueError, RayError) as error:
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0].rstrip(".")
        raise InputError(
            f"there is no Ray cluster to use at --address {address} ({reason}): start one with "
            "`ray start --head`, or name another."
        ) from None
    try:
        yield
    finally:
        ray.shutdown()


def _find(name: str) -> Any:
    """Returns the keeper of that name; None if there is none."""
    with suppress(ValueError):
        return ray.get_actor(name)
    return None


def _begin(run: RunDescription) -> Any:
    options = run.options
    own = (str(run.folder.path.parent), "--threads", str(options.cpus), "--restart", "3")
    return _keeper(LearnerKeeper, LEARNER, options.cpus, options.memory, options.gpus).remote(
        *(str(run.folder.path), str(Path.cwd())),
        *(run.begin(*own), run.resume(*own), run.actor(), options.tls),
    )


def _keeper(kind: type, name: str, cpus: int, memory: int, gpus: int = 0) -> Any:
    """Returns what makes a keeper with these resources, which Ray starts again whenever it ends."""
    return ray.remote(kind).options(  # type: ignore[call-overload, unused-ignore]
        **{"name": name, "lifetime": "detached", "max_restarts": -1},
        **{"num_cpus": cpus, "num_gpus": gpus, "memory": memory * _GIBIBYTE},
    )


def _scale(run: RunDescription) -> str:
    """Makes as many actors and evaluators as described of those there are; returns the change."""
    options = run.options
    wanted: dict[str, tuple[str, ...]] = {
        **{f"actor-{n + 1}": () for n in range(options.actors)},
        **{f"evaluator-{n + 1}": ("--evaluator",) for n in range(options.evaluators)},
    }
    there = {*ray.util.list_named_actors()} - {LEARNER}
    more = [name for name in wanted if name not in there]
    for name in more:
        _keeper(ActorKeeper, name, 1, options.actor_memory).remote(name, *wanted[name])
    fewer = [keeper for name in there - {*wanted} if (keeper := _find(name)) is not None]
    if fewer:  # one that has no node yet does not answer
        leaving = [keeper.leave.remote() for keeper in fewer]
        ray.wait(leaving, num_returns=len(fewer), timeout=_ANSWER)
    for keeper in fewer:
        ray.kill(keeper)
    return (
        f"actors: {options.actors}, evaluators: {options.evaluators} "
        f"({len(more)} begun, {len(fewer)} ended)"
    )


def _place(learner: Any, run: RunDescription) -> str:
    """Returns where the learner listens."""
    try:
        _, flags = ray.get(learner.join.remote(), timeout=_ANSWER)
    except ActorDiedError as error:
        reason = str(error).strip().splitlines()[-1]
        raise InputError(f"Ray cannot start the learner: {reason.rstrip('.')}.") from None
    except RayError:
        if run.folder.is_at_work():
            return "on its way: it waits until the run's former learner has ended"
        options = run.options
        gpus = f", {options.gpus} GPUs" if options.gpus else ""
        return (
            f"not placed yet: it waits for {options.cpus} cores{gpus} and {options.memory} GiB "
            "on one node (`ray status`)"
        )
    return f"at {flags[1]}"


def _stop(run: RunDescription, learner: Any) -> str:
    """Ends the run; returns when its checkpoint is written."""
    if learner is None:
        raise InputError(f"this cluster has no run called {run.folder.name}: name it with --run.")
    while _find(LEARNER) is not None:
        try:
            ray.get(learner.stop.remote(), timeout=_ANSWER)
        except GetTimeoutError:
            if not run.folder.is_at_work():  # it waits for a node; Ray would kill a learner too
                ray.kill(learner)
        except RayError:  # it is being started again, or is gone
            pass
        time.sleep(_LOOK)
    while run.folder.is_at_work():  # the learner writes its checkpoint
        time.sleep(_LOOK)
    return f"The run {run.folder.name} is over. The same command as before goes on with it."


def _wait(run: RunDescription, learner: Any) -> str:
    """Returns when the run is over, which Ctrl-C and SIGTERM bring about with a checkpoint.

    Raises:
        InputError: the learner failed; with its exit code.
    """
    stop, status = threading.Event(), None
    on_signals(stop)
    while not stop.wait(_LOOK):
        try:
            status = ray.get(learner.status.remote(), timeout=_ANSWER)
        except RayError:
            if _find(LEARNER) is None:
                raise InputError(
                    f"the run ended while nobody looked: read {run.folder.logs}/learner.log."
                ) from None
        if status is not None:
            break
    else:
        return _stop(run, learner)
    if status:
        error = InputError(
            f"the learner ended with exit code {status}: read {run.folder.logs}/learner.log."
        )
        error.exit_code = status
        raise error
    return f"The run {run.folder.name} is over."

"""Ray: the processes of a run are children of Ray actors, which Ray places and restarts.

The Ray actors are detached, so the launcher may leave. Launching the run again changes their
number.
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
from common.run.folder import Part
from deploy.description import RunDescription
from deploy.ray_keepers import (
    LEARNER,
    REPLAY,
    ActorKeeper,
    HubKeeper,
    LearnerKeeper,
    end_run,
)

_ANSWER = 30.0
"""Seconds to wait for a keeper's answer; a keeper that takes longer has no node yet."""
_LOOK = 1.0
_GIBIBYTE = 1024**3


def launch(run: RunDescription) -> str:
    """Lets the cluster run as many processes as described, and returns a report for the user."""
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
                "number of its processes, or first end it with --stop."
            )
        changed = _scale(run)
        told = (
            f"The {_hub()} is {_place(run)}; {changed}. Follow the run:\n  tail -F {log}\n"
            "End it, with a checkpoint:\n"
            f"  ale-robot launch ray --address {options.address} --run {run.folder.name} --stop"
        )
        if not options.wait:
            return told
        print(told, flush=True)
        return _wait(run, learner)


@contextmanager
def _connected(address: str, run: str) -> Iterator[None]:
    """Connects to the cluster within the block, in the namespace of ``run``."""
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
    """Returns the keeper called ``name``; None if there is none."""
    with suppress(ValueError):
        return ray.get_actor(name)
    return None


def _hub() -> Part:
    """Returns the process that is the hub of the run, as the run was begun."""
    return LEARNER if _find(REPLAY) is None else REPLAY


def _begin(run: RunDescription) -> Any:
    options, runs = run.options, str(run.folder.path.parent)
    place, restarts = (str(run.folder.path), str(Path.cwd())), ("--restart", "3")
    learner = run.learner_program(runs, "--threads", str(options.cpus), *restarts)
    size = (options.cpus, options.memory, options.gpus)
    as_hub = (run.actor(), options.tls)
    if not options.replay:
        return _keeper(HubKeeper, LEARNER, *size).remote(*place, learner, *as_hub)
    replay = run.replay_program(runs, *restarts)
    own_size = (options.replay_cpus, options.replay_memory)
    _keeper(HubKeeper, REPLAY, *own_size).remote(*place, replay, *as_hub)
    return _keeper(LearnerKeeper, LEARNER, *size).remote(*place, learner)


def _keeper(kind: type, name: str, cpus: int, memory: int, gpus: int = 0) -> Any:
    """Returns the maker of a keeper with these resources; Ray restarts the keeper whenever it
    ends."""
    return ray.remote(kind).options(  # type: ignore[call-overload, unused-ignore]
        **{"name": name, "lifetime": "detached", "max_restarts": -1},
        **{"num_cpus": cpus, "num_gpus": gpus, "memory": memory * _GIBIBYTE},
    )


def _scale(run: RunDescription) -> str:
    """Adds or ends actors and evaluators until there are as many as described; returns the
    change."""
    options = run.options
    wanted: dict[str, tuple[str, ...]] = {
        **{f"actor-{n + 1}": () for n in range(options.actors)},
        **{f"evaluator-{n + 1}": ("--evaluator",) for n in range(options.evaluators)},
    }
    there = {*ray.util.list_named_actors()} - {LEARNER, REPLAY}
    hub = _hub()
    more = [name for name in wanted if name not in there]
    for name in more:
        _keeper(ActorKeeper, name, 1, options.actor_memory).remote(name, hub, *wanted[name])
    fewer = [keeper for name in there - {*wanted} if (keeper := _find(name)) is not None]
    if fewer:  # with a timeout, as a keeper that has no node yet does not answer
        leaving = [keeper.leave.remote() for keeper in fewer]
        ray.wait(leaving, num_returns=len(fewer), timeout=_ANSWER)
    for keeper in fewer:
        ray.kill(keeper)
    return (
        f"actors: {options.actors}, evaluators: {options.evaluators} "
        f"({len(more)} begun, {len(fewer)} ended)"
    )


def _place(run: RunDescription) -> str:
    """Returns, in words, where the run's hub listens."""
    part = _hub()
    try:
        _, place, _ = ray.get(ray.get_actor(part).join.remote(), timeout=_ANSWER)
    except ActorDiedError as error:
        reason = str(error).strip().splitlines()[-1]
        raise InputError(f"Ray cannot start the {part}: {reason.rstrip('.')}.") from None
    except RayError:
        if run.folder.is_at_work(part):
            return f"starting: it waits until the run's former {part} has ended"
        options = run.options
        cpus, memory, gpus = options.cpus, options.memory, options.gpus
        if part == REPLAY:
            cpus, memory, gpus = options.replay_cpus, options.replay_memory, 0
        with_gpus = f", {gpus} GPUs" if gpus else ""
        return (
            f"not placed yet: it waits for {cpus} cores{with_gpus} and {memory} GiB "
            "on one node (`ray status`)"
        )
    return f"at {place[1]}"


def _stop(run: RunDescription, learner: Any) -> str:
    """Ends the run, and returns once its checkpoint is written."""
    if learner is None:
        raise InputError(f"this cluster has no run called {run.folder.name}: name it with --run.")
    while _find(LEARNER) is not None:
        try:
            ray.get(learner.stop.remote(), timeout=_ANSWER)
        except GetTimeoutError:
            if not run.folder.is_at_work("learner"):  # it waits for a node, so there is no process
                end_run()
        except RayError:  # it is being restarted, or has gone
            pass
        time.sleep(_LOOK)
    while run.folder.is_at_work():  # the learner writes its checkpoint
        time.sleep(_LOOK)
    return f"The run {run.folder.name} is over. The same command as before resumes it."


def _wait(run: RunDescription, learner: Any) -> str:
    """Waits until the run is over; Ctrl-C and SIGTERM end it, with a checkpoint. Raises InputError
    with the exit code of a learner that failed."""
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
        told = f"the learner ended with exit code {status}: read {run.folder.logs}/learner.log."
        raise InputError(told, status)
    return f"The run {run.folder.name} is over."

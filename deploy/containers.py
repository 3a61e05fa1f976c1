"""Commands of a run's containers, the same for every engine."""

import shlex

from common.endpoint import DEFAULT_PORT
from common.process.http_endpoints import HTTP_PORT
from deploy.description import Program, RunDescription

_RUNS = "/runs"
"""Mount point of the volumes."""


def replay_command(run: RunDescription, http: str, scheme: str) -> list[str]:
    """Returns the command of a separate replay, which begins the run or resumes it.

    Args:
        http: the host at which probes reach the process.
        scheme: tls or tcp.
    """
    own = ("--http", f"{http}:{HTTP_PORT}", *_listen(scheme))
    return _command(run, run.replay_program(_RUNS, *own))


def learner_command(run: RunDescription, http: str, scheme: str) -> list[str]:
    """Returns the command of the learner, with the arguments of `replay_command`."""
    place = _connect(run, scheme) if run.options.replay else _listen(scheme)
    own = ("--threads", str(run.options.cpus), "--http", f"{http}:{HTTP_PORT}", *place)
    return _command(run, run.learner_program(_RUNS, *own))


def actor_command(run: RunDescription, scheme: str, *role: str) -> list[str]:
    """Returns the command of an actor."""
    return ["python3", "-m", "actors", *_connect(run, scheme), *run.actor(), *role]


def _command(run: RunDescription, program: Program) -> list[str]:
    """Returns the command of a program whose part of the run lies on a volume."""
    first, again = (
        shlex.join(["exec", "python3", "-m", program.module, *flags])
        for flags in (program.begin, program.resume)
    )
    # The shell only asks the question, then `exec` replaces it, so signals reach the module.
    question = f"if [ -e {_RUNS}/{run.folder.name}/{program.begun} ]"
    return ["sh", "-c", f"{question}; then {again}; else {first}; fi"]


def _listen(scheme: str) -> list[str]:
    return ["--listen", f"{scheme}/0.0.0.0:{DEFAULT_PORT}", *_certificates(scheme)]


def _connect(run: RunDescription, scheme: str) -> list[str]:
    return ["--connect", f"{scheme}/{run.hub}:{DEFAULT_PORT}", *_certificates(scheme)]


def _certificates(scheme: str) -> list[str]:
    return ["--certificates", "/certificates"] if scheme == "tls" else []

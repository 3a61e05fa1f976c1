"""What containers of a run start, whichever engine has them."""

import shlex
from collections.abc import Sequence

from deploy.description import RunDescription

HUB_PORT = 7447
HTTP_PORT = 9108
_RUNS = "/runs"
"""Where the volumes are."""


def hub_of(run: RunDescription) -> str:
    """Returns the name by which the run's processes find its hub."""
    return "replay" if run.options.replay else "learner"


def replay_command(run: RunDescription, http: str, scheme: str) -> list[str]:
    """Returns the command of a replay of its own, which begins the run or goes on with it.

    Args:
        http: the address at which probes find the process.
        scheme: tls or tcp.
    """
    begin = run.replay(_RUNS, "--http", f"{http}:{HTTP_PORT}", *_listen(scheme))
    return _begin_or_resume(run, "replay", "replay", begin, [*begin, "--resume"])


def learner_command(run: RunDescription, http: str, scheme: str) -> list[str]:
    """Returns the command of the learner, with the arguments of `replay_command`."""
    own = ["--threads", str(run.options.cpus), "--http", f"{http}:{HTTP_PORT}"]
    if not run.options.replay:
        own += _listen(scheme)
        begin, resume = run.begin(_RUNS, *own), run.resume(_RUNS, *own)
        return _begin_or_resume(run, "learner", "replay", begin, resume)
    begin = run.begin(_RUNS, *own, *_connect(run, scheme), "--patience", "inf")
    # One that was ended while it waited for the replay has its settings, and nothing else: so what
    # the run begins with is told again.
    return _begin_or_resume(run, "learner", "config.json", begin, [*begin, "--resume"])


def actor_command(run: RunDescription, scheme: str, *role: str) -> list[str]:
    """Returns the command of an actor."""
    return ["python3", "-m", "actors", *_connect(run, scheme), *run.actor(), *role]


def _begin_or_resume(
    run: RunDescription, module: str, begun: str, begin: Sequence[str], resume: Sequence[str]
) -> list[str]:
    """Returns the command of a module that has one of two lists of flags.

    Args:
        begun: what is in the run's folder, on the volume, once the module is to resume.
    """
    first, again = (
        shlex.join(["exec", "python3", "-m", module, *flags]) for flags in (begin, resume)
    )
    # A shell is needed for the question alone: a signal reaches the module itself.
    question = f"if [ -e {_RUNS}/{run.folder.name}/{begun} ]"
    return ["sh", "-c", f"{question}; then {again}; else {first}; fi"]


def _listen(scheme: str) -> list[str]:
    return ["--listen", f"{scheme}/0.0.0.0:{HUB_PORT}", *_certificates(scheme)]


def _connect(run: RunDescription, scheme: str) -> list[str]:
    return ["--connect", f"{scheme}/{hub_of(run)}:{HUB_PORT}", *_certificates(scheme)]


def _certificates(scheme: str) -> list[str]:
    return ["--certificates", "/certificates"] if scheme == "tls" else []

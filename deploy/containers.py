"""What containers of a run start, whichever engine has them."""

import shlex

from deploy.description import RunDescription

HUB_PORT = 7447
HTTP_PORT = 9108


def learner_command(run: RunDescription, http: str, scheme: str) -> list[str]:
    """Returns the command that begins the run on the volume at /runs, or goes on with it.

    Args:
        http: the address at which probes find the learner.
        scheme: tls or tcp.
    """
    own = [
        *("--threads", str(run.options.cpus), "--http", f"{http}:{HTTP_PORT}"),
        *("--listen", f"{scheme}/0.0.0.0:{HUB_PORT}", *_certificates(scheme)),
    ]
    begin, resume = (
        shlex.join(["exec", "python3", "-m", "learner", *flags])
        for flags in (run.begin("/runs", *own), run.resume("/runs", *own))
    )
    # A shell is needed for the question alone: a signal reaches the learner itself.
    question = f"if [ -d /runs/{run.folder.name}/replay ]"
    return ["sh", "-c", f"{question}; then {resume}; else {begin}; fi"]


def actor_command(run: RunDescription, scheme: str, *role: str) -> list[str]:
    """Returns the command of an actor, which finds the learner by its name."""
    address = ["--connect", f"{scheme}/learner:{HUB_PORT}", *_certificates(scheme)]
    return ["python3", "-m", "actors", *address, *run.actor(), *role]


def _certificates(scheme: str) -> list[str]:
    return ["--certificates", "/certificates"] if scheme == "tls" else []

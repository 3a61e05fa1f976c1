"""Slurm: a job of the learner, which submits an array of actors when it begins.

A script is a head, which is written here, and a body, which is a file of `slurm/`: nothing is
filled into shell text but assignments.
"""

import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from common.errors import InputError, writing
from common.run.folder import write_atomically
from deploy.description import RunDescription

_HERE = Path(__file__).parent
_NOTICE = 90
"""Seconds before its time limit that a job is asked to end; it is queued again."""


def launch(run: RunDescription) -> str:
    """Writes the scripts, submits them if asked to, and returns what the user should know."""
    options, place = run.options, run.folder.path / "slurm"
    with writing(place):
        place.mkdir(parents=True, exist_ok=True)
        run.folder.logs.mkdir(exist_ok=True)
        shutil.copy(_HERE / "certificates.sh", place)
        for part, text in _heads(run).items():
            body = (_HERE / "slurm" / f"{part}.sh").read_text()
            write_atomically(place / f"{part}.sh", f"{text}\n{body}".encode())
    command = ["sbatch", str(place / "learner.sh")]
    if not options.submit:
        return f"The jobs are in {place}. Submit them:\n  {shlex.join(command)}"
    try:
        said = subprocess.run(command, capture_output=True, text=True)
    except FileNotFoundError:
        raise InputError("there is no sbatch here: submit from a machine of the cluster.") from None
    if said.returncode:
        raise InputError(f"sbatch refused the job: {said.stderr.strip()}")
    cancel = f"scancel --me --name {run.folder.name}"
    return (
        f"{said.stdout.strip()}. Follow it:\n  tail -F {run.folder.logs}/learner.log\n"
        f"End it, with a checkpoint:\n  {cancel}; {cancel}-actors"
    )


def _heads(run: RunDescription) -> dict[str, str]:
    """Returns the lines of each script that are the run's own."""
    options = run.options
    own = (str(run.folder.path.parent), "--threads", str(options.cpus), "--restart", "3")
    return {
        "learner": _head(
            run,
            f"--job-name={run.folder.name}",
            f"--output={run.folder.logs}/learner.log",
            f"--cpus-per-task={options.cpus}",
            f"--mem={options.memory}G",
            *([f"--gpus={options.gpus}"] if options.gpus else []),
            begin=run.begin(*own),
            resume=run.resume(*own),
        ),
        "actors": _head(
            run,
            f"--job-name={run.folder.name}-actors",
            f"--output={run.folder.logs}/actor-%a.log",
            f"--array=1-{options.actors + options.evaluators}",
            "--cpus-per-task=1",
            f"--mem={options.actor_memory}G",
            actors=[str(options.actors)],
            flags=run.actor(),
        ),
    }


def _head(run: RunDescription, *directives: str, **lists: list[str]) -> str:
    options = run.options
    shared = [
        *("--requeue", "--open-mode=append", f"--signal=B:USR1@{_NOTICE}"),
        f"--time={options.time}",
        *([f"--partition={options.partition}"] if options.partition else []),
        *([f"--account={options.account}"] if options.account else []),
    ]
    return "\n".join(
        [
            "#!/bin/bash",
            *(f"#SBATCH {each}" for each in [*directives, *shared]),
            f"run={run.folder.path}",
            f"python={sys.executable}",
            f"scheme={'tls' if options.tls else 'tcp'}",
            *(f"{name}=({shlex.join(words)})" for name, words in lists.items()),
        ]
    )

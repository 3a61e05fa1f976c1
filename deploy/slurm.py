"""Slurm: writes the job of the run's hub, which submits the other jobs when it begins.

A script consists of a head, which is written here, and a body, `slurm/job.sh`. Only assignments are
filled into shell text.
"""

import shlex
import socket
import subprocess
import sys
from pathlib import Path

from common.errors import InputError, writing
from common.exit_codes import FINAL, UNREACHABLE
from deploy.certificates import certify_actors
from deploy.description import Program, RunDescription
from deploy.engine_files import write_files

_HERE = Path(__file__).parent
_NOTICE = 90
"""Seconds before its time limit at which a job is asked to end; it is then queued again."""
FINAL_HERE = [str(number) for number in sorted({*FINAL, UNREACHABLE})]
"""Exit codes after which an actor is not restarted; they include that of an actor whose learner was
away for too long."""


def launch(run: RunDescription) -> str:
    """Writes the scripts, submits them if asked to, and returns a report for the user."""
    options, place = run.options, run.folder.path / "slurm"
    cancel = "; ".join(f"scancel --me --name {_job(run, part)}" for part in _parts(run))
    name = _job(run, run.hub)
    if options.submit and _slurm("squeue", "--noheader", "--me", "--name", name):
        raise InputError(
            f"a job called {name} is there already: end it first ({cancel}), "
            "or choose another --run."
        )
    body = (_HERE / "slurm" / "job.sh").read_text()
    files = {f"{part}.sh": f"{head}\n{body}".encode() for part, head in _heads(run).items()}
    with writing(place):
        run.folder.logs.mkdir(parents=True, exist_ok=True)
        certificates = (_HERE / "certificates.sh").read_bytes()
        kept = write_files(place, files | {"certificates.sh": certificates})
        if options.tls:
            certify_actors(run.folder.path / "certificates", socket.getfqdn(), _names(run))
    command = ["sbatch", str(place / f"{run.hub}.sh")]
    if not options.submit:
        return f"{kept}The jobs are in {place}. Submit them:\n  {shlex.join(command)}"
    return (
        f"{kept}{_slurm(*command)}. Follow it:\n  tail -F {run.folder.logs}/learner.log\n"
        f"End it, with a checkpoint:\n  {cancel}"
    )


def _slurm(command: str, *arguments: str) -> str:
    """Returns the output of a Slurm command. Raises InputError if the command is missing here, or
    fails."""
    try:
        said = subprocess.run([command, *arguments], capture_output=True, text=True)
    except FileNotFoundError:
        raise InputError(
            f"there is no {command} here: submit from a machine of the cluster."
        ) from None
    if said.returncode:
        raise InputError(f"{command} failed: {said.stderr.strip()}")
    return said.stdout.strip()


def _parts(run: RunDescription) -> list[str]:
    """Returns the run's jobs, in the order in which they should be ended."""
    return ["learner", "actors", *(["replay"] if run.options.replay else [])]


def _job(run: RunDescription, part: str) -> str:
    """Returns the name of a job; the hub's job has the name of the run."""
    return run.folder.name if part == run.hub else f"{run.folder.name}-{part}"


def _names(run: RunDescription) -> list[str]:
    """Returns the names of actors and evaluators, which `job.sh` derives from task numbers."""
    actors, all_of_them = run.options.actors, run.options.actors + run.options.evaluators
    return [f"{'actor' if n <= actors else 'evaluator'}-{n}" for n in range(1, all_of_them + 1)]


def _heads(run: RunDescription) -> dict[str, str]:
    """Returns the head of each script, which is specific to the run."""
    options, runs = run.options, str(run.folder.path.parent)
    own = ("--restart", "3")
    gpus = [f"--gpus={options.gpus}"] if options.gpus else []
    heads = {
        "learner": _head(
            run,
            run.learner_program(runs, "--threads", str(options.cpus), *own),
            *(f"--cpus-per-task={options.cpus}", f"--mem={options.memory}G", *gpus),
        ),
        "actors": _head(
            run,
            Program("actors", "address", run.actor(), run.actor(), "address"),
            f"--array=1-{options.actors + options.evaluators}",
            *("--cpus-per-task=1", f"--mem={options.actor_memory}G"),
        ),
    }
    if options.replay:
        size = f"--cpus-per-task={options.replay_cpus}", f"--mem={options.replay_memory}G"
        heads["replay"] = _head(run, run.replay_program(runs, *own), *size)
    return heads


def _head(run: RunDescription, program: Program, *directives: str) -> str:
    """Returns the head of a program's script."""
    options, part = run.options, program.module
    shared = [
        f"--job-name={_job(run, part)}",
        f"--output={run.folder.logs}/{'actor-%a' if part == 'actors' else part}.log",
        *("--requeue", "--open-mode=append", f"--signal=B:USR1@{_NOTICE}"),
        f"--time={options.time}",
        *([f"--partition={options.partition}"] if options.partition else []),
        *([f"--account={options.account}"] if options.account else []),
    ]
    others = [each for each in _parts(run) if each != part]
    lists = {
        "begin": program.begin,
        "resume": program.resume,
        "others": others,
        "jobs": [_job(run, each) for each in others],
        "final": FINAL_HERE,
    }
    return "\n".join(
        [
            "#!/bin/bash",
            *(f"#SBATCH {each}" for each in [*shared, *directives]),
            f"run={run.folder.path}",
            f"python={sys.executable}",
            f"scheme={'tls' if options.tls else 'tcp'}",
            f"module={part} hub={run.hub} begun={program.begun} kept={program.kept}",
            f"actors={options.actors}",
            *(f"{name}=({shlex.join(words)})" for name, words in lists.items()),
        ]
    )

"""Compose: all of a run's containers on one machine."""

import json
import shutil
from pathlib import Path
from typing import Any

from common.errors import InputError, writing
from common.run.folder import write_atomically
from deploy.containers import actor_command, learner_command
from deploy.description import RunDescription


def launch(run: RunDescription) -> str:
    """Writes the two files, and returns what the user should do with them."""
    options, place = run.options, run.folder.path / "compose"
    if options.gpus > 0:
        raise InputError("--gpus is for slurm and kubernetes: omit it, and see deploy/README.md.")
    actors = {"image": options.image, **_limits(1, options.actor_memory)}
    services = {
        "learner": {
            "image": options.image,
            "entrypoint": learner_command(run, "127.0.0.1", "tcp"),
            **_limits(options.cpus, options.memory),
        },
        "actor": {
            **actors,
            "entrypoint": actor_command(run, "tcp"),
            "scale": options.actors,
        },
        "evaluator": {
            **actors,
            "entrypoint": actor_command(run, "tcp", "--evaluator"),
            "scale": options.evaluators,
        },
    }
    # Compose fills in what follows a dollar.
    text = json.dumps({"services": services}, indent=2).replace("$", "$$")
    with writing(place):
        place.mkdir(parents=True, exist_ok=True)
        shutil.copy(Path(__file__).parent / "compose" / "compose.yaml", place)
        write_atomically(place / "compose.override.yaml", f"{text}\n".encode())
    return f"The run is in {place}. Start it:\n  cd {place} && docker compose up --detach"


def _limits(cpus: int, gibibytes: int) -> dict[str, Any]:
    return {"cpus": cpus, "mem_limit": f"{gibibytes}g"}

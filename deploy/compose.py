"""Compose: all containers of a run on one machine."""

import json
from pathlib import Path
from typing import Any

from common.errors import writing
from deploy.containers import actor_command, learner_command, replay_command
from deploy.description import RunDescription
from deploy.engine_files import write_files

_OWN = "compose.override.yaml"


def launch(run: RunDescription) -> str:
    """Writes the files, and returns what to do with them."""
    options, place = run.options, run.folder.path / "compose"
    learner, actor, evaluator = (
        learner_command(run, "127.0.0.1", "tcp"),
        actor_command(run, "tcp"),
        actor_command(run, "tcp", "--evaluator"),
    )
    memory = options.actor_memory
    services = {
        "learner": _service(run, learner, options.cpus, options.memory) | _gpus(options.gpus),
        "actor": _service(run, actor, 1, memory) | {"scale": options.actors},
        "evaluator": _service(run, evaluator, 1, memory) | {"scale": options.evaluators},
    }
    parts = ["compose.yaml"]
    if options.replay:
        parts.append("replay.yaml")
        replay = replay_command(run, "127.0.0.1", "tcp")
        services["replay"] = _service(run, replay, options.replay_cpus, options.replay_memory)
    # Compose would substitute a variable after each dollar sign.
    text = json.dumps({"services": services}, indent=2).replace("$", "$$")
    files = {part: (Path(__file__).parent / "compose" / part).read_bytes() for part in parts}
    files[_OWN] = f"{text}\n".encode()
    files[".env"] = f"COMPOSE_FILE={':'.join([*parts, _OWN])}\n".encode()
    with writing(place):
        kept = write_files(place, files)
    return f"{kept}The run is in {place}. Start it:\n  cd {place} && docker compose up --detach"


def _service(
    run: RunDescription, entrypoint: list[str], cpus: int, gibibytes: int
) -> dict[str, Any]:
    limits = {"cpus": cpus, "mem_limit": f"{gibibytes}g"}
    return {"image": run.options.image, "entrypoint": entrypoint, **limits}


def _gpus(number: int) -> dict[str, Any]:
    """Returns what reserves a ``number`` of NVIDIA GPUs for a service."""
    if not number:
        return {}
    device = {"driver": "nvidia", "count": number, "capabilities": ["gpu"]}
    return {"deploy": {"resources": {"reservations": {"devices": [device]}}}}

"""Kubernetes: a folder for `kubectl apply -k`, of the parts of every run and the run's own."""

import json
import re
import shutil
from itertools import chain
from pathlib import Path
from typing import Any

from common.errors import InputError, writing
from common.run.folder import write_atomically
from deploy.certificates import ensure_certificates
from deploy.containers import actor_command, learner_command, replay_command
from deploy.description import RunDescription

_HERE = Path(__file__).parent
_CONTAINER = "/spec/template/spec/containers/0"


def launch(run: RunDescription) -> str:
    """Writes the folder, with certificates, and returns what the user should do with it.

    Raises:
        InputError: the run's name is none for a namespace, or the folder cannot be written.
    """
    name, place = run.folder.name, run.folder.path / "kubernetes"
    if not re.fullmatch(r"[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?", name):
        raise InputError(
            f"run {name!r} cannot be a namespace: choose small letters, digits and '-' for --run."
        )
    with writing(place):
        shutil.copytree(_HERE / "kubernetes", place / "base", dirs_exist_ok=True)
        if run.options.tls:
            ensure_certificates(place / "certificates", run.hub)
        text = json.dumps(_kustomization(run), indent=2)
        write_atomically(place / "kustomization.yaml", f"{text}\n".encode())
    return (
        f"The run is in {place}. Start it:\n"
        f"  kubectl create namespace {name}\n  kubectl apply -k {place}"
    )


def _kustomization(run: RunDescription) -> dict[str, Any]:
    """Returns what differs from run to run; JSON is YAML."""
    options = run.options
    scheme = "tls" if options.tls else "tcp"
    image, tag = options.image.rsplit(":", 1)
    actor_size = (1, options.actor_memory)
    bounds = {
        "/spec/minReplicas": options.actors,
        "/spec/maxReplicas": max(options.actors, options.max_actors),
    }
    # A learner that is the hub has the hub's certificate beside that by which it signs weights.
    secrets: list[tuple[str, ...]] = [("hub", "learner")]
    components, replay = [], []
    if options.replay:
        secrets, components = [("hub",), ("learner",)], ["base/replay"]
        command = replay_command(run, "0.0.0.0", scheme)
        size = (options.replay_cpus, options.replay_memory)
        replay = [_workload("StatefulSet", "replay", command, *size)]
    return {
        "resources": ["base"],
        "components": components,
        "namespace": run.folder.name,
        "images": [{"name": "ale-robot", "newName": image, "newTag": tag}],
        "replicas": [{"name": "evaluators", "count": options.evaluators}],
        "secretGenerator": [_secret(*roles) for roles in (*secrets, ("actor",)) if options.tls],
        "patches": [
            *replay,
            _workload(
                *("StatefulSet", "learner", learner_command(run, "0.0.0.0", scheme)),
                *(options.cpus, options.memory, options.gpus),
            ),
            _workload("Deployment", "actors", actor_command(run, scheme), *actor_size),
            _workload(
                "Deployment", "evaluators", actor_command(run, scheme, "--evaluator"), *actor_size
            ),
            _patch("HorizontalPodAutoscaler", "actors", bounds),
        ],
    }


def _workload(
    kind: str, name: str, command: list[str], cpus: int, gibibytes: int, gpus: int = 0
) -> dict[str, Any]:
    memory = f"{gibibytes}Gi"
    limits = {"memory": memory} | ({"nvidia.com/gpu": str(gpus)} if gpus else {})
    resources = {"requests": {"cpu": str(cpus), "memory": memory}, "limits": limits}
    return _patch(
        kind, name, {f"{_CONTAINER}/command": command, f"{_CONTAINER}/resources": resources}
    )


def _patch(kind: str, name: str, values: dict[str, Any]) -> dict[str, Any]:
    steps = [{"op": "replace", "path": path, "value": value} for path, value in values.items()]
    return {"target": {"kind": kind, "name": name}, "patch": json.dumps(steps)}


def _secret(*roles: str) -> dict[str, Any]:
    """Returns the secret of a process that has the certificates of these roles."""
    pairs = [(f"{role}.pem", f"{role}-key.pem") for role in roles]
    files = ["ca.pem", *chain.from_iterable(pairs)]
    return {"name": roles[0], "files": [f"certificates/{file}" for file in files]}

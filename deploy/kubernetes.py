"""Kubernetes: writes a folder for `kubectl apply -k`, with a base and what is special to a run."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from common.errors import InputError, writing
from common.transport.credentials import common_name
from deploy.certificates import certify_actors, ensure_certificates
from deploy.containers import actor_command, learner_command, replay_command
from deploy.description import RunDescription
from deploy.engine_files import files_in, write_files

_HERE = Path(__file__).parent
_POD = "/spec/template/spec"
_CONTAINER = f"{_POD}/containers/0"


def launch(run: RunDescription) -> str:
    """Writes the folder, with certificates, and returns what to do with it. Raises InputError if
    the run's name cannot be a namespace, or the folder cannot be written."""
    name, place = run.folder.name, run.folder.path / "kubernetes"
    if not re.fullmatch(r"[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?", name):
        raise InputError(
            f"run {name!r} cannot be a namespace: use lower-case letters, digits and '-' in --run."
        )
    base = {f"base/{name}": text for name, text in files_in(_HERE / "kubernetes").items()}
    own = (json.dumps(_kustomization(run), indent=2) + "\n").encode()
    with writing(place):
        if run.options.tls:
            ensure_certificates(place / "certificates", run.hub)
            certify_actors(place / "certificates", run.hub, _names(run))
        kept = write_files(place, base | {"kustomization.yaml": own})
    if run.learner.steps is not None:
        kept += "warning: Kubernetes starts a learner that has all its steps again: omit --steps.\n"
    return (
        f"{kept}The run is in {place}. Start it:\n"
        f"  kubectl create namespace {name}\n  kubectl apply --server-side -k {place}"
    )


def _most_actors(run: RunDescription) -> int:
    return max(run.options.actors, run.options.max_actors)


def _names(run: RunDescription) -> list[str]:
    """Returns the possible names of the pods of all actors and evaluators."""
    counts = {"actors": _most_actors(run), "evaluators": run.options.evaluators}
    return [f"{name}-{number}" for name, count in counts.items() for number in range(count)]


def _kustomization(run: RunDescription) -> dict[str, Any]:
    """Returns the kustomization of this run, which is written as JSON, because JSON is YAML."""
    options = run.options
    scheme = "tls" if options.tls else "tcp"
    image, tag = options.image.rsplit(":", 1)
    bounds = {"/spec/minReplicas": options.actors, "/spec/maxReplicas": _most_actors(run)}
    # A learner that is the hub needs two certificates: the hub's, and its own to sign weights.
    secrets = {"hub": ["actors.txt", *_files("hub", "learner")]}
    components, replay = [], []
    if options.replay:
        secrets = {"hub": ["actors.txt", *_files("hub")], "learner": _files("learner")}
        components = ["base/replay"]
        command = replay_command(run, "0.0.0.0", scheme)
        replay = [_workload("replay", command, options.replay_cpus, options.replay_memory)]
    secrets["actor"] = _files(*(common_name("actor", name) for name in _names(run)))
    actors = [
        patch
        for name, role in (("actors", ()), ("evaluators", ("--evaluator",)))
        for patch in _actors(run, name, actor_command(run, scheme, "--name", "$(POD_NAME)", *role))
    ]
    return {
        "resources": ["base"],
        "components": components,
        "namespace": run.folder.name,
        "images": [{"name": "ale-robot", "newName": image, "newTag": tag}],
        "replicas": [{"name": "evaluators", "count": options.evaluators}],
        "secretGenerator": [
            {"name": name, "files": [f"certificates/{file}" for file in ("ca.pem", *files)]}
            for name, files in secrets.items()
            if options.tls
        ],
        "patches": [
            *replay,
            _workload(
                *("learner", learner_command(run, "0.0.0.0", scheme)),
                *(options.cpus, options.memory, options.gpus),
            ),
            *actors,
            _patch("HorizontalPodAutoscaler", "actors", bounds),
        ],
    }


def _actors(run: RunDescription, name: str, command: list[str]) -> Iterator[dict[str, Any]]:
    """Yields the patches of actors or evaluators; without TLS they mount no certificates."""
    yield _workload(name, command, 1, run.options.actor_memory)
    if not run.options.tls:
        scratch = {f"{_POD}/volumes": [{"name": "scratch", "emptyDir": {}}]}
        mount = {f"{_CONTAINER}/volumeMounts": [{"name": "scratch", "mountPath": "/tmp"}]}
        yield _patch("StatefulSet", name, scratch | mount)


def _workload(
    name: str, command: list[str], cpus: int, gibibytes: int, gpus: int = 0
) -> dict[str, Any]:
    memory = f"{gibibytes}Gi"
    limits = {"memory": memory} | ({"nvidia.com/gpu": str(gpus)} if gpus else {})
    resources = {"requests": {"cpu": str(cpus), "memory": memory}, "limits": limits}
    values = {f"{_CONTAINER}/command": command, f"{_CONTAINER}/resources": resources}
    return _patch("StatefulSet", name, values)


def _patch(kind: str, name: str, values: dict[str, Any]) -> dict[str, Any]:
    steps = [{"op": "replace", "path": path, "value": value} for path, value in values.items()]
    return {"target": {"kind": kind, "name": name}, "patch": json.dumps(steps)}


def _files(*names: str) -> list[str]:
    """Returns the files of the certificates with these names."""
    return [file for name in names for file in (f"{name}.pem", f"{name}-key.pem")]

"""Launched runs: one with a replay of its own, the commands that its containers get, and the
objects that a cluster would."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from deploy.__main__ import main

Commands = dict[str, list[str]]


def launch(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    monkeypatch.setattr(sys, "argv", ["ale-robot launch", *arguments])
    main()


def launch_replay(monkeypatch: pytest.MonkeyPatch, engine: str, runs: Path, *flags: str) -> Path:
    """Launches a run called r with a replay of its own; returns the folder of what is written."""
    own = (engine, "--replay", "--run=r", f"--runs={runs}", "--actors=1", "--cpus=1")
    launch(monkeypatch, *own, "--", *flags)
    return runs / "r" / engine


def compose_commands(place: Path) -> Commands:
    services = json.loads((place / "compose.override.yaml").read_text())["services"]
    return {
        name: [word.replace("$$", "$") for word in service["entrypoint"]]
        for name, service in services.items()
    }


def kubernetes_commands(place: Path) -> Commands:
    found: Commands = {}
    for each in json.loads((place / "kustomization.yaml").read_text())["patches"]:
        values = {step["path"]: step["value"] for step in json.loads(each["patch"])}
        command = values.get("/spec/template/spec/containers/0/command")
        if command is not None:
            found[each["target"]["name"].rstrip("s")] = command
    return found


def kustomized(place: Path, namespace: str) -> dict[tuple[str, str], Any]:
    """Returns whatever `kubectl apply -k` would send, by kind and name, each as its schema wants it
    and in ``namespace``."""
    kubernetes_validate = pytest.importorskip("kubernetes_validate")
    yaml = pytest.importorskip("yaml")
    if shutil.which("kubectl") is None:
        pytest.skip("kubectl is not installed")
    made = subprocess.run(["kubectl", "kustomize", place], check=True, capture_output=True)
    found = {}
    for each in yaml.safe_load_all(made.stdout):
        kubernetes_validate.validate(each, "1.32", strict=True)
        assert each["metadata"]["namespace"] == namespace
        found[each["kind"], each["metadata"]["name"]] = each
    return found


COMMANDS = {"compose": compose_commands, "kubernetes": kubernetes_commands}

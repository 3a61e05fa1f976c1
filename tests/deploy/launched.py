"""Launching a run with a replay of its own, and the commands that its containers get."""

import json
import sys
from pathlib import Path

import pytest

from deploy.__main__ import main

Commands = dict[str, list[str]]


def launch(monkeypatch: pytest.MonkeyPatch, engine: str, runs: Path, *flags: str) -> Path:
    own = (engine, "--replay", "--run=r", f"--runs={runs}", "--actors=1", "--cpus=1")
    monkeypatch.setattr(sys, "argv", ["ale-robot launch", *own, "--", *flags])
    main()
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


COMMANDS = {"compose": compose_commands, "kubernetes": kubernetes_commands}

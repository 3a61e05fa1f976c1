"""What Compose and Kubernetes get of a run with `--replay`."""

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

from common.command_line.run_options import parse_run
from learner.options import LearnerOptions
from replay.__main__ import ReplayOptions
from tests.deploy.launched import COMMANDS, kustomized, launch, launch_replay


@pytest.mark.parametrize("engine", COMMANDS)
def test_the_replay_has_the_settings_that_the_learners_flags_mean(
    engine: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Also those that come from a file, and from a flag for many of them."""
    more = tmp_path / "more.toml"
    more.write_text("[replay]\ncapacity = 54_321\n[play]\nminimal-actions = false\n")
    given = (
        "--randomise.all",
        "--camera.noise=0.1",
        "--learning.n-step",
        "5",
        "--robot=robotroller",
    )
    learners = ("--steps=300000", "--keep-snapshots", "--films=1", "--initial", "robot_pong_pixels")
    both = ("--actor-quota=77", "--log-json", "--restart", "2")
    flags = (f"--config={more}", "--preset=robot", *given, *learners, *both, "--http=127.0.0.1:1")
    commands = COMMANDS[engine](launch_replay(monkeypatch, engine, tmp_path / "runs", *flags))
    shell, dash_c, text = commands["replay"]
    told = re.fullmatch(
        r"if \[ -e /runs/r/replay \]; then exec python3 -m replay (.+) --resume; "
        r"else exec python3 -m replay (.+); fi",
        text,
    )
    assert (shell, dash_c) == ("sh", "-c")
    assert told is not None
    assert told[1] == told[2]
    replay = parse_run(ReplayOptions, "replay", told[2].split(), lambda _: None)
    learner = parse_run(LearnerOptions, "learner", flags, lambda _: None)
    assert replay.config == learner.config
    assert replay.config.replay.capacity == 54_321
    assert (replay.actor_quota, replay.log_json, replay.restart) == (77, True, 2)
    assert (replay.run, str(replay.runs), replay.resume) == ("r", "/runs", False)
    assert replay.http is not None
    assert replay.http.endswith(":9108")


def test_a_learner_that_only_waited_for_its_replay_still_knows_what_it_begins_with(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    flags = ("--env=ale", "--initial", "ale_pong")
    place = launch_replay(monkeypatch, "compose", tmp_path, *flags)
    _, _, text = COMMANDS["compose"](place)["learner"]
    told = re.fullmatch(
        r"if \[ -e /runs/r/config.json \]; then exec python3 -m learner (.+) --resume; "
        r"else exec python3 -m learner (.+); fi",
        text,
    )
    assert told is not None
    assert told[1] == told[2]
    learner = parse_run(LearnerOptions, "learner", told[1].split(), lambda _: None)
    learner.check()
    assert learner.initial is not None
    assert (learner.connect, learner.patience) == ("tcp/replay:7447", float("inf"))


def test_compose_has_all_files_of_a_run_by_env(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    yaml = pytest.importorskip("yaml")
    place = launch_replay(monkeypatch, "compose", tmp_path)
    name, _, files = (place / ".env").read_text().strip().partition("=")
    assert name == "COMPOSE_FILE"
    base, replay, own = (yaml.safe_load((place / each).read_text()) for each in files.split(":"))
    services = base["services"], replay["services"], own["services"]
    assert set(services[0]) | {"replay"} == set(services[2])
    # As safe as the learner, and on the same volume and network.
    for key in ("read_only", "tmpfs", "cap_drop", "security_opt", "volumes", "networks", "restart"):
        assert services[1]["replay"][key] == services[0]["learner"][key]
    assert services[1]["learner"] == {"depends_on": ["replay"]}
    launch(monkeypatch, "compose", "--run=r", f"--runs={tmp_path}")
    assert (place / ".env").read_text() == "COMPOSE_FILE=compose.yaml:compose.override.yaml\n"


@pytest.fixture
def objects(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[tuple[str, str], Any]:
    """Whatever `kubectl apply -k` would send, by kind and name; secrets without their hash."""
    own = ("--run=r", f"--runs={tmp_path}", "--image=host:5000/a:1")
    size = ("--replay-cpus=3", "--replay-memory=5")
    launch(monkeypatch, "kubernetes", "--replay", *size, *own)
    return kustomized(tmp_path / "r/kubernetes", "r")


def test_kubernetes_gives_it_a_workload(objects: dict[tuple[str, str], Any]) -> None:
    pods = {name: objects["StatefulSet", name]["spec"] for name in ("replay", "learner")}
    secrets = {name: each for (kind, name), each in objects.items() if kind == "Secret"}
    own = {
        "replay": {"actors.txt", "hub.pem", "hub-key.pem"},
        "learner": {"learner.pem", "learner-key.pem"},
    }
    for name, pod in pods.items():
        template = pod["template"]["spec"]
        (container,) = template["containers"]
        assert container["image"] == "host:5000/a:1"
        assert template["securityContext"]["runAsNonRoot"]
        assert container["securityContext"]["readOnlyRootFilesystem"]
        (claim,) = pod["volumeClaimTemplates"]
        mounts = {mount["name"]: mount["mountPath"] for mount in container["volumeMounts"]}
        assert mounts[claim["metadata"]["name"]] == "/runs"
        assert mounts["certificates"] == "/certificates"
        (secret,) = (each["secret"] for each in template["volumes"] if "secret" in each)
        assert set(secrets[secret["secretName"]]["data"]) == {"ca.pem", *own[name]}
        ports = {each["name"]: each["containerPort"] for each in container["ports"]}
        assert ports == {"http": 9108} | ({"hub": 7447} if name == "replay" else {})
        for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
            assert container[probe]["httpGet"]["port"] == "http"
        service = objects["Service", pod["serviceName"]]["spec"]
        assert {each["name"]: each["port"] for each in service["ports"]}.items() <= ports.items()
        assert service["selector"].items() <= pod["template"]["metadata"]["labels"].items()
    assert objects["Service", "replay"]["spec"]["publishNotReadyAddresses"]
    (container,) = pods["replay"]["template"]["spec"]["containers"]
    assert container["resources"]["requests"] == {"cpu": "3", "memory": "5Gi"}


def test_who_may_reach_whom_on_kubernetes(objects: dict[tuple[str, str], Any]) -> None:
    """All pairs of pods, as the policies allow them together: both ends must."""
    labels = {
        name: each["spec"]["template"]["metadata"]["labels"]
        for (kind, name), each in objects.items()
        if kind in ("StatefulSet", "Deployment")
    }
    policies = [each["spec"] for (kind, _), each in objects.items() if kind == "NetworkPolicy"]

    def chosen(selector: dict[str, Any], own: dict[str, str]) -> bool:
        return selector.get("matchLabels", {}).items() <= own.items() and all(
            own[each["key"]] in each["values"] for each in selector.get("matchExpressions", [])
        )

    def allowed(direction: str, peers: str, own: str, other: str, port: int) -> bool:
        return any(
            {"port": port} in rule["ports"]
            and any(
                "podSelector" in peer and chosen(peer["podSelector"], labels[other])
                for peer in rule[peers]
            )
            for policy in policies
            if chosen(policy["podSelector"], labels[own])
            for rule in policy.get(direction, [])
        )

    reached = {
        (one, other, port)
        for one in labels
        for other in labels
        for port in (7447, 9108)
        if allowed("egress", "to", one, other, port)
        and allowed("ingress", "from", other, one, port)
    }
    assert reached == {(each, "replay", 7447) for each in ("actors", "evaluators", "learner")}
    into = {
        name: objects["NetworkPolicy", f"to-the-{name}"]["spec"]["ingress"]
        for name in ("learner", "replay")
    }
    assert into["learner"] == into["replay"][1:]
    assert [rule["ports"] for rule in into["learner"]] == [[{"port": 9108}]]


def test_a_hub_that_has_another_name_now_gets_its_certificate(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def names() -> str:
        hub = tmp_path / "r/kubernetes/certificates/hub.pem"
        show = ["openssl", "x509", "-in", str(hub), "-noout", "-ext", "subjectAltName"]
        return subprocess.run(show, check=True, capture_output=True, text=True).stdout

    launch(monkeypatch, "kubernetes", "--run=r", f"--runs={tmp_path}")
    assert "DNS:learner" in names()
    authority = (tmp_path / "r/kubernetes/certificates/ca.pem").read_bytes()
    launch_replay(monkeypatch, "kubernetes", tmp_path)
    assert "DNS:replay" in names()
    assert (tmp_path / "r/kubernetes/certificates/ca.pem").read_bytes() == authority
    secrets = json.loads((tmp_path / "r/kubernetes/kustomization.yaml").read_text())
    assert {
        each["name"]: [Path(file).name for file in each["files"]]
        for each in secrets["secretGenerator"]
    } == {
        "hub": ["ca.pem", "actors.txt", "hub.pem", "hub-key.pem"],
        "learner": ["ca.pem", "learner.pem", "learner-key.pem"],
        "actor": [
            *("ca.pem", "actor.actors-0.pem", "actor.actors-0-key.pem"),
            *("actor.evaluators-0.pem", "actor.evaluators-0-key.pem"),
        ],
    }

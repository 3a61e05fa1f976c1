"""What Kubernetes and Compose get of a run: valid for them, and what learner and actors accept."""

import json
import shlex
import subprocess
from base64 import b64decode
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.x509.oid import NameOID

from actors.options import ActorOptions
from common.command_line.parser import parse
from common.command_line.run_options import parse_run
from common.transport.credentials import Credentials
from learner.options import LearnerOptions
from tests.deploy.launched import kustomized, launch
from tests.paths import ROOT

RUN = ("--run=pong", "--actors=3", "--max-actors=6", "--evaluators=2", "--cpus=5", "--memory=7")
FLAGS = ("--env", "ale", "--initial", "ale_pong", "--learning.n-step", "5")


def launch_pong(monkeypatch: pytest.MonkeyPatch, engine: str, runs: Path, *own: str) -> Path:
    launch(monkeypatch, engine, f"--runs={runs}", *RUN, *own, "--", *FLAGS)
    return runs / "pong" / engine


def begins_and_resumes(command: Sequence[str]) -> tuple[LearnerOptions, list[str]]:
    """Returns what a learner's container begins with, and the flags with which it goes on."""
    shell, dash_c, text = command
    assert (shell, dash_c) == ("sh", "-c")
    words = shlex.split(text.replace(";", " ; "))
    program = ["exec", "python3", "-m", "learner"]
    at, again = (i for i in range(len(words)) if words[i : i + 4] == program and i)
    assert words[:at] == ["if", "[", "-e", "/runs/pong/replay", "]", ";", "then"]
    resumed, begun = words[at + 4 : again - 2], words[again + 4 : -2]
    options = parse_run(LearnerOptions, "learner", begun, lambda options: None)
    options.check()
    assert options.config.learning.n_step == 5
    assert options.initial is not None
    assert (options.run, str(options.runs), options.threads) == ("pong", "/runs", 5)
    assert "--resume" in resumed
    assert "--initial" not in resumed
    return options, resumed


def joins(command: Sequence[str]) -> ActorOptions:
    assert list(command[:3]) == ["python3", "-m", "actors"]
    options = parse(ActorOptions, "actors", command[3:])
    options.check()
    return options


@pytest.fixture
def objects(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[tuple[str, str], Any]:
    """Whatever `kubectl apply -k` would send, by kind and name."""
    place = launch_pong(monkeypatch, "kubernetes", tmp_path, "--image=host:5000/a:1", "--gpus=1")
    return kustomized(place, "pong")


def test_kubernetes_gets_what_was_described(objects: dict[tuple[str, str], Any]) -> None:
    hpa = objects["HorizontalPodAutoscaler", "actors"]["spec"]
    assert (hpa["minReplicas"], hpa["maxReplicas"]) == (3, 6)
    target = hpa["scaleTargetRef"]
    assert (target["kind"], target["name"]) == ("StatefulSet", "actors")
    assert objects["StatefulSet", "evaluators"]["spec"]["replicas"] == 2
    assert "replicas" not in objects["StatefulSet", "actors"]["spec"]  # they are the autoscaler's
    pods = {
        name: objects["StatefulSet", name]["spec"]["template"]
        for name in ("learner", "actors", "evaluators")
    }
    secrets = [name for kind, name in objects if kind == "Secret"]
    for pod in pods.values():
        (container,) = pod["spec"]["containers"]
        assert container["image"] == "host:5000/a:1"
        assert pod["spec"]["securityContext"]["runAsNonRoot"]
        assert container["securityContext"]["readOnlyRootFilesystem"]
        (secret,) = (each["secret"] for each in pod["spec"]["volumes"] if "secret" in each)
        assert secret["secretName"] in secrets
    (container,) = pods["learner"]["spec"]["containers"]
    assert container["resources"]["limits"] == {"memory": "7Gi", "nvidia.com/gpu": "1"}
    learner, _ = begins_and_resumes(container["command"])
    ports = {each["name"]: each["containerPort"] for each in container["ports"]}
    assert learner.listen == f"tls/0.0.0.0:{ports['hub']}"
    assert learner.http == f"0.0.0.0:{ports['http']}"
    hub = objects["Service", "learner"]["spec"]
    assert hub["publishNotReadyAddresses"]
    for name, is_evaluator in (("actors", False), ("evaluators", True)):
        (container,) = pods[name]["spec"]["containers"]
        actor = joins(container["command"])
        assert actor.connect == f"tls/learner:{hub['ports'][0]['port']}"
        assert actor.evaluator is is_evaluator


def test_each_pod_of_kubernetes_is_let_through_to_where_it_must(
    objects: dict[tuple[str, str], Any],
) -> None:
    labels = {
        name: each["spec"]["template"]["metadata"]["labels"]
        for (kind, name), each in objects.items()
        if kind == "StatefulSet"
    }

    def chosen(selector: dict[str, Any]) -> set[str]:
        return {
            name
            for name, own in labels.items()
            if selector.get("matchLabels", {}).items() <= own.items()
            and all(own[e["key"]] in e["values"] for e in selector.get("matchExpressions", []))
        }

    policies = {
        name: each["spec"] for (kind, name), each in objects.items() if kind == "NetworkPolicy"
    }
    assert chosen(policies["nothing-else"]["podSelector"]) == set(labels)
    hub, figures = policies["to-the-learner"]["ingress"]
    assert chosen(policies["to-the-learner"]["podSelector"]) == {"learner"}
    assert chosen(hub["from"][0]["podSelector"]) == {"actors", "evaluators"}
    assert hub["ports"] == [{"port": 7447}]
    assert figures["ports"] == [{"port": 9108}]
    out = policies["from-the-actors"]
    assert chosen(out["podSelector"]) == {"actors", "evaluators"}
    assert chosen(out["egress"][0]["to"][0]["podSelector"]) == {"learner"}
    assert out["egress"][0]["ports"] == [{"port": 7447}]
    assert chosen(objects["PodDisruptionBudget", "actors"]["spec"]["selector"]) == {"actors"}
    assert chosen({"matchLabels": objects["Service", "learner"]["spec"]["selector"]}) == {"learner"}


def test_the_certificates_of_kubernetes_are_for_its_hub(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    place = launch_pong(monkeypatch, "kubernetes", tmp_path) / "certificates"
    for role in ("hub", "learner"):
        Credentials.find(place, role)
    show = ["openssl", "x509", "-in", str(place / "hub.pem"), "-noout", "-ext", "subjectAltName"]
    shown = subprocess.run(show, check=True, capture_output=True, text=True)
    assert "DNS:learner" in shown.stdout
    secrets = json.loads((place.parent / "kustomization.yaml").read_text())["secretGenerator"]
    files = {each["name"]: [Path(file).name for file in each["files"]] for each in secrets}
    assert files.pop("actor")[:3] == ["ca.pem", "actor.actors-0.pem", "actor.actors-0-key.pem"]
    own = ["hub.pem", "hub-key.pem", "learner.pem", "learner-key.pem"]
    assert files == {"hub": ["ca.pem", "actors.txt", *own]}
    before = (place / "hub.pem").read_bytes()
    launch_pong(monkeypatch, "kubernetes", tmp_path)
    assert (place / "hub.pem").read_bytes() == before


PODS = [*(f"actors-{number}" for number in range(6)), "evaluators-0", "evaluators-1"]


def test_each_actor_of_kubernetes_has_the_certificate_of_its_name_alone(
    objects: dict[tuple[str, str], Any], tmp_path: Path
) -> None:
    secrets = {
        name: {file: b64decode(text) for file, text in each["data"].items()}
        for (kind, name), each in objects.items()
        if kind == "Secret"
    }
    (hub,) = (each for name, each in secrets.items() if name.startswith("hub-"))
    assert hub["actors.txt"].decode().split() == PODS
    serials = set()
    for pod in PODS:
        spec = objects["StatefulSet", pod.split("-")[0]]["spec"]["template"]["spec"]
        (container,) = spec["containers"]
        named = [{"name": "POD_NAME", "valueFrom": {"fieldRef": {"fieldPath": "metadata.name"}}}]
        assert container["env"] == named
        command = [word.replace("$(POD_NAME)", pod) for word in container["command"]]
        actor = joins(command)
        assert actor.name == pod
        assert actor.certificates is not None
        volumes = {each["name"]: each for each in spec["volumes"]}
        place = tmp_path / pod
        place.mkdir()
        for mount in container["volumeMounts"]:
            path = Path(mount["mountPath"])
            if path.is_relative_to(actor.certificates):
                file = mount.get("subPath") or mount["subPathExpr"].replace("$(POD_NAME)", pod)
                secret = secrets[volumes[mount["name"]]["secret"]["secretName"]]
                (place / path.relative_to(actor.certificates)).write_bytes(secret[file])
        found = Credentials.find(place, "actor", actor.name)
        certificate = x509.load_pem_x509_certificate(found.certificate.read_bytes())
        (subject,) = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
        assert subject.value == f"actor.{pod}"
        serials.add(certificate.serial_number)
    assert len(serials) == len(PODS)


def test_kubernetes_without_certificates_has_no_place_for_them(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    found = kustomized(launch_pong(monkeypatch, "kubernetes", tmp_path, "--no-tls"), "pong")
    assert not [name for kind, name in found if kind == "Secret"]
    for name in ("actors", "evaluators"):
        spec = found["StatefulSet", name]["spec"]["template"]["spec"]
        assert [each["name"] for each in spec["volumes"]] == ["scratch"]
        (container,) = spec["containers"]
        assert [each["mountPath"] for each in container["volumeMounts"]] == ["/tmp"]


def test_kubernetes_warns_of_a_run_that_would_begin_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    launch_pong(monkeypatch, "kubernetes", tmp_path)
    assert "warning" not in capsys.readouterr().out
    launch(monkeypatch, "kubernetes", f"--runs={tmp_path}", *RUN, "--", *FLAGS, "--steps=9000000")
    assert "warning: Kubernetes starts a learner that has all its" in capsys.readouterr().out


def test_compose_gets_what_was_described(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    yaml = pytest.importorskip("yaml")
    place = launch_pong(monkeypatch, "compose", tmp_path)
    services = json.loads((place / "compose.override.yaml").read_text())["services"]
    base = yaml.safe_load((place / "compose.yaml").read_text())
    assert set(services) == set(base["services"])
    learner, _ = begins_and_resumes(services["learner"]["entrypoint"])
    assert learner.listen == "tcp/0.0.0.0:7447"
    # Where nobody but the run's containers is.
    assert base["networks"] == {"hub": {"internal": True}}
    assert f"http://{learner.http}/healthz" in (ROOT / "deploy" / "Containerfile").read_text()
    assert (services["actor"]["scale"], services["evaluator"]["scale"]) == (3, 2)
    assert joins(services["actor"]["entrypoint"]).connect == "tcp/learner:7447"
    assert joins(services["evaluator"]["entrypoint"]).evaluator
    assert not any("deploy" in service for service in services.values())


def test_compose_reserves_gpus_for_the_learner_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    place = launch_pong(monkeypatch, "compose", tmp_path, "--gpus=2")
    services = json.loads((place / "compose.override.yaml").read_text())["services"]
    (device,) = services["learner"].pop("deploy")["resources"]["reservations"]["devices"]
    assert device == {"driver": "nvidia", "count": 2, "capabilities": ["gpu"]}
    assert not any("deploy" in service for service in services.values())

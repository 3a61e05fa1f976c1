"""Whole runs whose processes show each other certificates."""

import json
import shutil
from pathlib import Path

import pytest

from tests.actors.numbered_env import GAME_OVER, GOES_ON
from tests.certificates import certify
from tests.end_to_end.conftest import SMALL, Program, Stage
from tests.recordings import record


@pytest.fixture
def certificates(certificates: Path, tmp_path: Path, stage: Stage) -> Path:
    """Those of the stage, whose addresses they are for from now on."""
    stage.endpoint = stage.endpoint.replace("tcp/", "tls/")
    return shutil.copytree(certificates, tmp_path / "certificates")


def certify_by_name(folder: Path, name: str) -> Path:
    """The folder that an actor's own machine has."""
    certify(folder, "--actors", name)
    own = folder.with_name(f"machine-of-{name}")
    own.mkdir()
    for file in ("ca.pem", f"actor.{name}.pem", f"actor.{name}-key.pem"):
        shutil.copy(folder / file, own)
    return own


def balanced(stage: Stage) -> bool:
    chunks = stage.summary()["chunks"]
    return bool(chunks["made"] == chunks["acked"] > 0 == chunks["refused"])


def test_local_mode(stage: Stage, certificates: Path) -> None:
    learner = stage.learner(
        *("--local", "--certificates", str(certificates), "--env=ale", "--steps=500", *SMALL)
    )
    learner.ends()
    assert balanced(stage)
    assert {row["phase"] for row in stage.rows()} == {"random", "train", "test"}


def test_actors_are_who_their_certificates_say(stage: Stage, certificates: Path) -> None:
    own = {name: certify_by_name(certificates, name) for name in ("robot-7", "tester", "gone")}
    (certificates / "actors.txt").write_text("robot-7\ntester\n")
    flags = ("--certificates", str(certificates), "--env=ale", *SMALL)
    learner = stage.learner(*flags, "--steps=500")
    learner.says("actors find it at")
    place = ("-m", "actors", "--sync", "--connect", stage.endpoint, "--certificates")
    stranger = stage.start(*place, str(certificates), "--name=actor-1", "--patience=0")
    assert "does not list actor-1: make its certificate with" in stranger.ends(2)
    shut_out = stage.start(*place, str(own["gone"]), "--patience=0")
    shut_out.ends(4)
    # One that says another name has no certificate of that name.
    liar = stage.start(*place, str(own["tester"]), "--name=robot-7", "--patience=0")
    assert f"{own['tester'] / 'actor.robot-7.pem'}" in liar.ends(2)
    actor = stage.start(*place, str(own["robot-7"]))
    tester = stage.start(*place, str(own["tester"]), "--evaluator")
    learner.ends()
    assert "not used" not in actor.ends()
    tester.ends()
    kept = (stage.run / "logs" / "learner.jsonl").read_text()
    for told in ("robot-7 joined", "tester joined"):
        assert told in learner.output
        assert told in kept
    assert "the hub does not admit the certificate of actor.gone" in kept
    assert stage.summary()["shut_out"] == 1
    assert balanced(stage)
    assert {row["phase"] for row in stage.rows()} == {"random", "train", "test"}


def test_a_replay_of_its_own_with_an_actor_and_an_evaluator(
    stage: Stage, certificates: Path
) -> None:
    own = ("--certificates", str(certificates))
    flags = ("--env=ale", *SMALL)
    its = certificates.with_name("machine-of-the-hub")
    its.mkdir()
    for file in ("ca.pem", "hub.pem", "hub-key.pem"):
        shutil.copy(certificates / file, its)
    listens = ("--listen", stage.endpoint, "--run=r", "--certificates", str(its))
    hub = stage.start("-m", "replay", *listens, *flags)
    hub.says("replay of run r")
    place = ("--run=r", "--connect", stage.endpoint, "--threads=1")
    learner = stage.start("-m", "learner", *place, *own, "--steps=500", *flags)
    stranger = stage.actor("s", "--patience=0")
    assert "needs --certificates FOLDER" in stranger.ends(2)
    actor = stage.actor("a", *own)
    evaluator = stage.actor("e", "--evaluator", *own)
    learner.ends()
    assert "not used" not in actor.ends()
    assert "not taken" not in evaluator.ends()
    assert balanced(stage)
    assert {row["phase"] for row in stage.rows()} == {"random", "train", "test"}


def test_two_runs_share_a_hub_and_do_not_see_each_other(stage: Stage, certificates: Path) -> None:
    """The hub is the first run's learner; the second has a replay that joins it."""
    certify(certificates, "--runs", "two")
    own = {name: certify_by_name(certificates, name) for name in ("left", "right", "tester")}
    its = certificates.with_name("machine-of-two")
    its.mkdir()
    for file in ("ca.pem", "replay.two.pem", "replay.two-key.pem"):
        shutil.copy(certificates / file, its)
    flags, secure = ("--env=ale", *SMALL), ("--certificates", str(certificates))
    first = stage.learner(*flags, *secure, "--steps=300")
    first.says("actors find it at")
    place = ("-m", "replay", "--connect", stage.endpoint)
    third = (*place, "--run=three", *flags, "--certificates")
    assert f"certificates.sh {its} --runs three" in stage.start(*third, str(its)).ends(2)
    certify(certificates, "--runs", "three")
    stage.start(*third, str(certificates)).says(
        "if nobody finds three, check whether the hub's runs.txt"
    )
    second = stage.start(*place, "--run=two", "--certificates", str(its), *flags)
    second.says("replay of run two")
    lost = stage.start(
        *("-m", "actors", "--sync", "--connect", stage.endpoint, "--patience=0"),
        *("--certificates", str(own["left"])),
    )
    assert "the hub serves several runs (r, two): name one with --run" in lost.ends(2)
    join = ("--connect", stage.endpoint, "--run=two")
    learner = stage.start(*("-m", "learner", *join, *secure, "--threads=1", "--steps=500", *flags))
    learner.says("actors find it at")

    def actor(name: str, run: str, *others: str) -> Program:
        place = ("--connect", stage.endpoint, "--run", run, "--certificates", str(own[name]))
        return stage.start("-m", "actors", "--sync", *place, *others)

    of_second = [actor("right", "two"), actor("tester", "two", "--evaluator")]
    for each in (learner, *of_second):  # before the hub goes
        each.ends()
    actor("left", "r").ends()
    first.ends()
    names = {"r": ["left"], "two": ["right", "tester"]}
    for run, expected in names.items():
        summary = json.loads((stage.folder / "runs" / run / "summary.json").read_text())
        assert [each["name"] for each in summary["actors"]] == expected
        chunks = summary["chunks"]
        assert chunks["made"] == chunks["acked"] > 0 == chunks["refused"]
        log = (stage.folder / "runs" / run / "logs" / "learner.jsonl").read_text()
        (other,) = names.keys() - {run}
        assert not any(f"{name} joined" in log for name in names[other])


def test_actors_turn_away_weights_that_a_hub_has_signed(stage: Stage, certificates: Path) -> None:
    stolen = shutil.copytree(certificates, certificates.with_name("stolen"))
    for end in (".pem", "-key.pem"):
        shutil.copy(stolen / f"hub{end}", stolen / f"learner{end}")
    learner = stage.learner("--certificates", str(stolen), "--env=ale", "--steps=500", *SMALL)
    learner.says("actors find it at")
    actor = stage.actor("a", "--certificates", str(certificates))
    actor.says("weights 0 were not used: their signer's certificate is not that of a learner")


def test_a_learner_may_send_demonstrations_to_a_replay_of_its_own(
    stage: Stage, certificates: Path
) -> None:
    record(stage.folder / "d", [*[GOES_ON] * 9, GAME_OVER], 400)
    flags = ("--certificates", str(certificates), "--env=ale", *SMALL)
    hub = stage.start("-m", "replay", "--listen", stage.endpoint, "--run=r", *flags)
    hub.says("replay of run r")
    place = ("--run=r", "--connect", stage.endpoint, "--threads=1", "--steps=300")
    given = ("--demonstrations", str(stage.folder / "d"))
    learner = stage.start("-m", "learner", *place, *flags, *given)
    assert "demonstrations joined" in learner.ends()
    assert balanced(stage)
    assert [each["name"] for each in stage.summary()["actors"]] == ["demonstrations"]

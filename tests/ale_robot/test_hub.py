"""Policies given to and fetched from a model hub, with the real library and a hub of the test's."""

import base64
import hashlib
import importlib.util
import json
import re
import shutil
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, cast

import pytest

from ale_robot.hub import Pull, Push
from common.errors import InputError
from common.exit_codes import UNREACHABLE
from common.run.origin import SHIPPED
from tests.paths import ROOT

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("huggingface_hub") is None,
    reason="huggingface_hub is not installed: pip install 'ale-robot[hub]'",
)
SHA = "0123456789abcdef0123456789abcdef01234567"
REPOSITORY = "me/pong"


class Hub(ThreadingHTTPServer):
    """As much of a model hub as one repository needs."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Answers)
        self.files: dict[str, bytes] = {}
        self.sizes: dict[str, int] = {}
        """Sizes that it tells, where they are not the true ones."""
        self.private = False
        self.fetched: list[str] = []
        self.url = f"http://127.0.0.1:{self.server_port}"


class _Answers(BaseHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Silent."""

    def _reply(self, content: bytes, status: int = 200, **headers: str) -> None:
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)

    def _tell(self, **content: Any) -> None:
        self._reply(json.dumps(content).encode(), Content_Type="application/json")

    def do_POST(self) -> None:
        hub = cast(Hub, self.server)
        body = self.rfile.read(int(self.headers["Content-Length"]))
        if self.path == "/api/repos/create":
            hub.private = b"private" in body
            self._tell(url=f"{hub.url}/{REPOSITORY}", name=REPOSITORY)
        elif "/preupload/" in self.path:
            files = [
                {"path": each["path"], "uploadMode": "regular", "shouldIgnore": False}
                for each in json.loads(body)["files"]
            ]
            self._tell(files=files, commitOid=SHA)
        elif "/commit/" in self.path:
            for line in body.splitlines():
                entry = json.loads(line)
                if entry["key"] == "file":
                    content = base64.b64decode(entry["value"]["content"])
                    hub.files[entry["value"]["path"]] = content
            self._tell(
                success=True, commitOid=SHA, commitUrl=f"{hub.url}/{REPOSITORY}/commit/{SHA}"
            )
        else:
            self._tell(errors=[], warnings=[])  # of the card's header

    def do_GET(self) -> None:
        hub = cast(Hub, self.server)
        if self.path.startswith(f"/api/models/{REPOSITORY}"):
            siblings = [
                {"rfilename": name, "size": hub.sizes.get(name, len(content))}
                for name, content in hub.files.items()
            ]
            self._tell(id=REPOSITORY, sha=SHA, siblings=siblings, tags=[], private=False)
        elif found := re.fullmatch(rf"/{REPOSITORY}/resolve/{SHA}/(.+)", self.path):
            content = hub.files[found[1]]
            hub.fetched.append(found[1])
            etag = hashlib.sha1(content).hexdigest()
            self._reply(content, ETag=f'"{etag}"', X_Repo_Commit=SHA)
        else:
            self._reply(b"{}", 404, X_Error_Code="RepoNotFound")

    do_HEAD = do_GET


@pytest.fixture
def hub(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Hub]:
    from huggingface_hub import constants

    with Hub() as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        template = constants.HUGGINGFACE_CO_URL_TEMPLATE.replace(constants.ENDPOINT, server.url)
        monkeypatch.setattr(constants, "HUGGINGFACE_CO_URL_TEMPLATE", template)
        monkeypatch.setattr(constants, "ENDPOINT", server.url)
        monkeypatch.setattr(constants, "HF_HUB_DISABLE_XET", True)
        monkeypatch.setenv("HF_TOKEN", "hf_nobody")
        yield server
        server.shutdown()


@pytest.fixture
def pushed(hub: Hub) -> Hub:
    Push("ale_pong", REPOSITORY).run()
    return hub


def test_what_is_pushed_is_pulled_and_plays(
    pushed: Hub, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not pushed.private
    assert set(pushed.files) == {"ale_pong.safetensors", "ale_pong.json", "README.md"}
    assert pushed.files["ale_pong.safetensors"] == (SHIPPED / "ale_pong.safetensors").read_bytes()
    Pull(REPOSITORY, tmp_path / "mine").run()
    there = {file.name: file.read_bytes() for file in (tmp_path / "mine").iterdir()}
    assert there == {name: pushed.files[name] for name in ("ale_pong.safetensors", "ale_pong.json")}
    assert f"watch {tmp_path}/mine/ale_pong.safetensors" in capsys.readouterr().out
    with pytest.raises(InputError, match="already exists"):
        Pull(REPOSITORY, tmp_path / "mine").run()


def test_the_card_tells_people_and_the_hub_the_scores(pushed: Hub) -> None:
    from huggingface_hub import ModelCard

    card = ModelCard(pushed.files["README.md"].decode())
    told = json.loads((SHIPPED / "ale_pong.json").read_bytes())["evaluation"]["rows"]
    assert card.data.pipeline_tag == "reinforcement-learning"
    results = card.data.eval_results
    assert {result.dataset_type for result in results} == {"ALERobot/Pong-Emulator-v0"}
    assert [result.metric_value for result in results] == [
        f"{row['mean']:.2f} +/- {row['deviation']:.2f}" for row in told
    ]
    digest = hashlib.sha256(pushed.files["ale_pong.safetensors"]).hexdigest()
    assert digest in card.text
    assert json.loads(pushed.files["ale_pong.json"])["sha256"] == digest
    assert "735,387 agent steps of 66.7 ms" in card.text


def test_the_card_tells_of_other_worlds_where_they_were_played(hub: Hub, pushed: Hub) -> None:
    assert "25 other worlds" not in pushed.files["README.md"].decode()
    Push("robot_pong_robust", REPOSITORY).run()
    told = " ".join(hub.files["README.md"].decode().split())
    measured = json.loads(
        (ROOT / "benchmarks/results/robustness_robot_pong_robust.json").read_bytes()
    )["cells"]
    means = [cell["mean"] for cell in measured]
    words = f"its mean score is {sum(means) / 25:.2f}, and {min(means):.2f} in the worst"
    assert f"In 25 other worlds, with 10 games each, {words}" in told
    assert "the worst: hands up to 200 ms later" in told
    assert "pixels, its commands and keys, and chooses" in told  # it feels no joints
    Push("robot_pong", REPOSITORY).run()
    told = " ".join(hub.files["README.md"].decode().split())
    assert "pixels, its commands, keys and joints, and chooses" in told


@pytest.mark.parametrize(
    ("initial", "words"),
    [
        (None, "It was trained for"),  # fresh weights
        ("robot_pong#sha256=0", "It was fine-tuned from robot_pong for"),
        (True, "It was fine-tuned from another network for"),  # a former version's
    ],
)
def test_the_card_names_the_network_that_the_training_began_with(
    hub: Hub, tmp_path: Path, initial: object, words: str
) -> None:
    for suffix in ("safetensors", "json"):
        shutil.copy(SHIPPED / f"ale_pong.{suffix}", tmp_path)
    card = json.loads((tmp_path / "ale_pong.json").read_bytes()) | {"initial": initial}
    (tmp_path / "ale_pong.json").write_text(json.dumps(card))
    Push(str(tmp_path / "ale_pong.safetensors"), REPOSITORY).run()
    assert words in " ".join(hub.files["README.md"].decode().split())


def test_a_private_repository_is_asked_for(hub: Hub) -> None:
    Push("ale_pong", REPOSITORY, private=True).run()
    assert hub.private


def test_a_network_without_a_card_is_not_pushed(hub: Hub, tmp_path: Path) -> None:
    shutil.copy(SHIPPED / "ale_pong.safetensors", tmp_path / "bare.safetensors")
    with pytest.raises(InputError, match="has no card beside it"):
        Push(str(tmp_path / "bare.safetensors"), REPOSITORY).run()
    assert hub.files == {}


def test_a_policy_without_scores_is_not_pushed(hub: Hub, tmp_path: Path) -> None:
    for suffix in ("safetensors", "json"):
        shutil.copy(SHIPPED / f"ale_pong.{suffix}", tmp_path)
    card = json.loads((tmp_path / "ale_pong.json").read_bytes())
    del card["evaluation"]
    (tmp_path / "ale_pong.json").write_text(json.dumps(card))
    with pytest.raises(InputError, match="has no scores in its card: make it with"):
        Push(str(tmp_path / "ale_pong.safetensors"), REPOSITORY).run()
    assert hub.files == {}


def damage(hub: Hub) -> None:
    weights = bytearray(hub.files["ale_pong.safetensors"])
    weights[-1] ^= 1
    hub.files["ale_pong.safetensors"] = bytes(weights)


def replace_by_noise(hub: Hub) -> None:
    noise = b"\x80\x04" + b"cposix\nsystem\n" * 9  # a pickle's opcodes
    card = json.loads(hub.files["ale_pong.json"])
    card["sha256"] = hashlib.sha256(noise).hexdigest()
    hub.files |= {"ale_pong.safetensors": noise, "ale_pong.json": json.dumps(card).encode()}


def rename(name: str) -> Any:
    def act(hub: Hub) -> None:
        for suffix in ("safetensors", "json"):
            hub.files[f"{name}.{suffix}"] = hub.files.pop(f"ale_pong.{suffix}")

    return act


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (damage, "does not match its card"),
        (replace_by_noise, "holds no network"),
        (rename("../up"), "holds no policy"),
        (rename("a/b"), "holds no policy"),
        (lambda hub: hub.files.pop("ale_pong.json"), "holds no policy"),
        (lambda hub: hub.sizes.update({"ale_pong.safetensors": 2**40}), "at most 67,108,864"),
        (lambda hub: hub.sizes.update({"ale_pong.json": 0}), "at most 1,048,576"),
        (lambda hub: hub.files.update({"ale_pong.json": b"[" * 100_000}), "has no card"),
        (lambda hub: hub.files.update({"ale_pong.json": b"{}"}), "has no card"),
    ],
)
def test_what_is_no_policy_is_not_kept(
    pushed: Hub, tmp_path: Path, change: Any, sentence: str
) -> None:
    change(pushed)
    with pytest.raises(InputError, match=sentence):
        Pull(REPOSITORY, tmp_path / "mine").run()
    assert not (tmp_path / "mine").exists()
    if "at most" in sentence:
        assert pushed.fetched == [] or pushed.fetched == ["ale_pong.safetensors"] * 2


def test_a_repository_that_is_not_there_is_told_in_a_sentence(hub: Hub, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the hub does not serve me/nothing: "):
        Pull("me/nothing", tmp_path).run()


@pytest.mark.parametrize("name", ["pong", "no name", "a/b/c", "/pong", "me/"])
def test_what_names_no_repository_is_refused_before_the_hub_is_asked(
    tmp_path: Path, name: str
) -> None:
    with pytest.raises(InputError, match=f"^{name} names no repository: write OWNER/NAME"):
        Pull(name, tmp_path).run()
    with pytest.raises(InputError, match=f"^{name} names no repository: write OWNER/NAME"):
        Push("ale_pong", name).run()


def test_a_hub_that_is_away_has_an_exit_code_of_its_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    hub = pytest.importorskip("huggingface_hub")

    def away(self: object, **_: object) -> None:
        raise ConnectionError("[Errno -2] Name or service not known")

    monkeypatch.setattr(hub.HfApi, "model_info", away)
    with pytest.raises(
        InputError, match=r"^the hub cannot be reached \(\[Errno -2\] Name or"
    ) as told:
        Pull("me/pong", tmp_path).run()
    assert told.value.exit_code == UNREACHABLE

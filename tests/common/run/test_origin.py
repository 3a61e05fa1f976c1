"""Networks on disk are found, and tell the settings of their training."""

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest
from safetensors.torch import save

from common.errors import InputError
from common.network import build_network
from common.protocol.weights import encode_weights
from common.run.folder import RunFolder
from common.run.network_file import encode_network_file
from common.run.origin import (
    SHIPPED,
    copied_from,
    find_weights,
    identity_of,
    not_a_network,
    origin_of,
    run_meant_by,
)
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from common.settings.stored_config import to_json

TRAINED = replace(PRESETS["robot"], play=replace(PRESETS["robot"].play, vector=True))


def test_a_file_on_its_own_tells_the_settings_of_its_training(tmp_path: Path) -> None:
    file, card = tmp_path / "p.safetensors", tmp_path / "p.json"
    network = build_network(TRAINED, 6)
    file.write_bytes(encode_network_file(network, TRAINED))
    assert origin_of(file) == TRAINED
    card.write_text(f'{{"config": {to_json(RunConfig())}}}')  # which somebody gave the same name
    assert origin_of(file) == TRAINED
    file.write_bytes(encode_weights(network))  # as former versions wrote it
    assert origin_of(file) == RunConfig()
    card.unlink()
    assert origin_of(file) is None
    file.write_bytes(b"no network")
    with pytest.raises(InputError, match=r"holds no network .*: name a \.safetensors file\.$"):
        origin_of(file)
    file.unlink()  # as its reader will say
    assert origin_of(file) is None


def test_a_network_is_identified_by_its_name_and_its_content(tmp_path: Path) -> None:
    file = tmp_path / "r" / "checkpoint.safetensors"
    file.parent.mkdir()
    file.write_bytes(b"abc")
    # FIPS 180-4's example.
    sha256 = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert identity_of(file) == f"r/checkpoint.safetensors#sha256={sha256}"
    shipped = find_weights("robot_pong")
    assert identity_of(shipped) == (
        f"robot_pong#sha256={hashlib.sha256(shipped.read_bytes()).hexdigest()}"
    )
    file.unlink()
    with pytest.raises(InputError, match=r"checkpoint\.safetensors"):
        identity_of(file)


def test_a_copy_tells_of_what_it_is_one(tmp_path: Path) -> None:
    copy, network = tmp_path / "initial.safetensors", build_network(TRAINED, 6)
    copy.write_bytes(encode_network_file(network, TRAINED, identity="a#sha256=0"))
    assert copied_from(copy) == "a#sha256=0"
    assert origin_of(copy) == TRAINED
    copy.write_bytes(encode_network_file(network, TRAINED))  # as former versions wrote it
    assert copied_from(copy) is None
    copy.write_bytes(b"damaged")
    assert copied_from(copy) is None


def test_the_network_of_a_run_that_lost_its_newest_is_the_one_before(tmp_path: Path) -> None:
    run = RunFolder(tmp_path, "r")
    run.path.mkdir()
    run.config_file.write_text(to_json(TRAINED))
    with pytest.raises(InputError, match=r"r/checkpoint\.safetensors does not exist"):
        find_weights(run.path)
    run.previous.write_bytes(encode_network_file(build_network(TRAINED, 6), TRAINED))
    assert find_weights(run.path) == run.previous
    run.checkpoint.write_bytes(b"half of it")
    assert find_weights(run.path) == run.checkpoint
    with pytest.raises(InputError, match=rf"checkpoint\.safe.* is damaged .*: name {run.previous}"):
        origin_of(run.checkpoint)


@pytest.mark.parametrize("name", ["checkpoint.previous", "snapshots/epoch-0001"])
def test_only_the_newest_network_has_one_before_it(tmp_path: Path, name: str) -> None:
    run = RunFolder(tmp_path, "r")
    (run.path / "snapshots").mkdir(parents=True)
    run.config_file.write_text(to_json(TRAINED))
    run.previous.touch()
    told = str(not_a_network(run.path / f"{name}.safetensors", ValueError("x")))
    assert told.endswith(": name a .safetensors file.")


def test_a_published_name_in_another_folder_is_not_the_published_policy() -> None:
    with pytest.raises(InputError, match=r"^elsewhere/robot_pong does not exist"):
        find_weights("elsewhere/robot_pong")


def test_a_link_to_itself_is_no_file(tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(link)
    with pytest.raises(InputError, match="link is not a file: name a network's file"):
        find_weights(link)


@pytest.mark.parametrize(
    ("told", "words"),
    [("{", "is not JSON .*: get it again"), ("{}", r"p\.safetensors: config has a missing")],
)
def test_settings_in_a_file_are_not_trusted(tmp_path: Path, told: str, words: str) -> None:
    file = tmp_path / "p.safetensors"
    file.write_bytes(save({}, {"config": told}))
    with pytest.raises(InputError, match=words):
        origin_of(file)


def test_a_file_that_was_probably_meant_is_told(tmp_path: Path) -> None:
    run = RunFolder(tmp_path, "r")
    run.snapshots.mkdir(parents=True)
    run.config_file.write_text("{}")
    run.checkpoint.touch()
    missing = run.snapshots / "bst.safetensors"
    with pytest.raises(InputError, match=r"bst\.safetensors does not exist: name .* once a test"):
        find_weights(missing)
    (run.snapshots / "best.safetensors").touch()
    with pytest.raises(InputError, match=r"does not exist: did you mean best\.safetensors\?"):
        find_weights(missing)


def test_a_network_goes_by_the_name_under_which_it_was_published(tmp_path: Path) -> None:
    mine = tmp_path / "policies" / "mine.v2"
    mine.parent.mkdir()
    file = mine.with_name("mine.v2.safetensors")
    with pytest.raises(InputError, match=r"mine\.v2 does not exist: name a network's file"):
        find_weights(mine)
    with pytest.raises(InputError, match="policies is not a file: name a network's file"):
        find_weights(mine.parent)
    file.touch()
    assert find_weights(mine) == find_weights(file) == file


def test_the_name_of_a_shipped_policy_is_that_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ale_pong.safetensors").touch()
    shipped = SHIPPED / "ale_pong.safetensors"
    assert find_weights("ale_pong") == find_weights("policies/ale_pong") == shipped
    assert find_weights("ale_pong.safetensors") == Path("ale_pong.safetensors")


def test_a_run_goes_by_its_name_unless_a_file_or_a_policy_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("first", "ale_pong"):
        folder = tmp_path / "runs" / name
        folder.mkdir(parents=True)
        (folder / "config.json").write_text("{}")
        (folder / "checkpoint.safetensors").touch()
    newest = Path("runs/first/checkpoint.safetensors")
    assert find_weights("first") == newest
    run = run_meant_by(Path("first"))
    assert run is not None
    assert run.name == "first"
    assert find_weights("ale_pong") == SHIPPED / "ale_pong.safetensors"
    assert run_meant_by(Path("ale_pong")) is None
    assert find_weights("runs/ale_pong") == Path("runs/ale_pong/checkpoint.safetensors")
    Path("first").mkdir()  # no run
    assert find_weights("first") == newest
    Path("first").rmdir()
    published = Path("first.safetensors")
    published.touch()
    assert find_weights("first") == published
    Path("first").touch()
    assert find_weights("first") == Path("first")
    assert run_meant_by(Path("first")) is None
    assert find_weights("runs/first") == newest

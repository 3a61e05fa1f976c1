"""A published policy: small weights, a card, and scores of just these weights."""

import hashlib
import json
import threading
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import save

from common.command_line.played import playing_settings
from common.errors import InputError
from common.exit_codes import INTERRUPTED
from common.network import build_network
from common.protocol.weights import encode_weights
from common.run.epochs import EpochTable
from common.run.network_file import decode_network_file
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from common.settings.ranges import RandomiseConfig
from common.settings.stored_config import to_json
from learner.evaluation.snapshots import Snapshots
from learner.publish import Options, main, publish
from tests.common.run.test_epochs import TRAIN
from viewer.player import ShownPolicy

FAST = PRESETS["fast"]
CONFIG = replace(
    FAST,
    game="breakout",
    play=replace(FAST.play, max_game_frames=400, random_starts=0),
    randomise=RandomiseConfig(actuation_latency=4),
)
SUMMARY = {
    "run": "small",
    "agent_steps": 12_345,
    "updates": 3_000,
    "wall_seconds": 60.0,
    "random_reward": 1.0,
    "machine": {"cpu": "A processor", "cores": 2},
    "git_commit": None,
    "config": json.loads(to_json(CONFIG)),
}


def _run(folder: Path) -> Path:
    (folder / "snapshots").mkdir(parents=True)
    (folder / "config.json").write_text(to_json(CONFIG))
    (folder / "summary.json").write_text(json.dumps(SUMMARY))
    for epoch, steps, updates, seconds in ((2, 6_000, 1_500, 20.0), (3, 9_000, 2_000, 30.0)):
        row = replace(TRAIN, epoch=epoch, total_train_steps=steps, weight_updates=updates)
        EpochTable(folder / "epochs.csv").append(replace(row, total_time=seconds))
    (folder / "snapshots/best.json").write_text('{"epoch": 3, "train_steps": 9000}')
    network = build_network(CONFIG, 4)
    (folder / "snapshots/best.safetensors").write_bytes(encode_weights(network))
    return folder


@pytest.mark.usefixtures("forks")
def test_a_policy_plays_from_its_two_files_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Each of the three evaluations starts a process for each core.
    monkeypatch.setattr("os.sched_getaffinity", lambda process: {0})
    run, output = _run(tmp_path / "small"), tmp_path / "policies" / "breakout"
    publish(Options(run=run, output=output, games=2, best=True), threading.Event())

    weights = output.with_suffix(".safetensors")
    card = json.loads(output.with_suffix(".json").read_text())
    assert weights.stat().st_size < 4_000_000
    assert card["sha256"] == hashlib.sha256(weights.read_bytes()).hexdigest()
    # Until its own epoch, not those of the run's end.
    assert (card["agent_steps"], card["updates"], card["wall_seconds"]) == (19_000, 2_000, 30.0)
    assert card["snapshot"]["epoch"] == 3
    evaluation = card["evaluation"]
    assert evaluation["weights"] == "breakout"
    assert [(row["epsilon"], row["sticky"]) for row in evaluation["rows"]] == [
        (0.001, 0.0), (0.05, 0.0), (0.001, 0.25)
    ]  # fmt: skip
    for row in evaluation["rows"]:
        assert row["games"] == len(row["scores"]) == 2
        assert row["steps_of_games"] == [100, 100]  # 400 frames, as the run's games
    assert playing_settings(weights) == CONFIG.for_play
    player = ShownPolicy.of_file(CONFIG, weights, 0.0, 1)
    torch.manual_seed(0)
    frames = torch.randint(256, (4, 4, 84, 84), dtype=torch.uint8)
    with torch.no_grad():
        ours = player.network(frames, torch.zeros(4, 0))
        theirs = build_network(CONFIG, 4)(frames, torch.zeros(4, 0))
    torch.testing.assert_close(ours, theirs, rtol=1e-2, atol=1e-3)


def test_no_conditions_are_drawn_for_the_scores_of_the_card(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    played: list[RunConfig] = []

    def evaluate(
        network: Path, asked: object, config: RunConfig, *others: object, name: str
    ) -> dict[str, str]:
        played.append(config)
        return {}

    monkeypatch.setattr("learner.publish.evaluate", evaluate)
    card = publish(
        Options(_run(tmp_path / "small"), tmp_path / "breakout", best=True), threading.Event()
    )
    assert played == [replace(CONFIG, randomise=RandomiseConfig())]
    assert card["config"]["randomise"]["actuation_latency"] == 4


def test_the_card_tells_which_network_the_run_began_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("learner.publish.evaluate", lambda *given, name: {})
    run = _run(tmp_path / "small")
    (run / "summary.json").write_text(json.dumps(SUMMARY | {"initial": "a/b#sha256=0"}))
    assert (
        publish(Options(run, tmp_path / "one", best=True), threading.Event())["initial"]
        == "a/b#sha256=0"
    )


def test_the_epoch_of_the_best_test_must_be_known(tmp_path: Path) -> None:
    run = _run(tmp_path / "small")
    (run / "snapshots/best.json").write_text('{"epoch": 4, "train_steps": 9000}')
    with pytest.raises(InputError, match=r"epochs.csv lacks the epoch of .*best.json: put it back"):
        publish(Options(run, tmp_path / "breakout", best=True), threading.Event())


@pytest.mark.parametrize("output", [".", "/", "..", "policies/.."])
def test_an_output_without_a_name_is_refused(tmp_path: Path, output: str) -> None:
    options = Options(_run(tmp_path / "small"), Path(output), best=True)
    with pytest.raises(InputError, match="names no file: give -o a name"):
        publish(options, threading.Event())


@pytest.mark.parametrize("output", ["mine.safetensors", "mine.json"])
def test_a_name_with_the_suffix_of_a_file_is_refused(tmp_path: Path, output: str) -> None:
    options = Options(_run(tmp_path / "small"), tmp_path / output)
    with pytest.raises(InputError, match=rf"{output} has a suffix: give -o the name without it"):
        publish(options, threading.Event())


@pytest.mark.parametrize("output", ["checkpoint", "config", "snapshots/best"])
def test_the_runs_own_files_are_not_replaced(tmp_path: Path, output: str) -> None:
    run = _run(tmp_path / "small")
    before = {file: file.read_bytes() for file in run.rglob("*") if file.is_file()}
    with pytest.raises(InputError, match="is inside of the run: name a file outside"):
        publish(Options(run, run / output, best=True), threading.Event())
    assert {file: file.read_bytes() for file in run.rglob("*") if file.is_file()} == before


def test_a_run_without_a_test_is_told(tmp_path: Path) -> None:
    (file := tmp_path / "weights.safetensors").touch()
    for other in (tmp_path, file, tmp_path / "none"):
        with pytest.raises(InputError, match=f"^{other} is not a run: name one"):
            publish(Options(run=other, output=tmp_path / "policy", best=True), threading.Event())
    (tmp_path / "begun").mkdir()
    (tmp_path / "begun/config.json").write_text(to_json(CONFIG))
    with pytest.raises(InputError, match=r"best.* continue the run until it does"):
        publish(
            Options(run=tmp_path / "begun", output=tmp_path / "policy", best=True),
            threading.Event(),
        )


def test_a_run_goes_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "runs/begun").mkdir(parents=True)
    (tmp_path / "runs/begun/config.json").write_text(to_json(CONFIG))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"^runs/begun/snapshots/best.* continue the run until"):
        publish(
            Options(run=Path("begun"), output=tmp_path / "policy", best=True), threading.Event()
        )


def test_a_run_whose_tests_nobody_plays_is_published_by_its_last_network(tmp_path: Path) -> None:
    run, output = _run(tmp_path / "small"), tmp_path / "policy"
    (run / "snapshots/best.safetensors").rename(run / "checkpoint.safetensors")
    with pytest.raises(InputError, match=r"has ended, so none .* last one without --best, or"):
        publish(Options(run, output, best=True), threading.Event())
    card = publish(Options(run, output, games=1), threading.Event())
    assert output.with_suffix(".safetensors").is_file()
    assert (card["agent_steps"], card["updates"]) == (12_345, 3_000)  # all that is known
    # The learner was killed after a checkpoint that its summary does not know.
    state = {"updates": 3_500, "seconds": 70.5, "books": {"agent_steps": 14_000}}
    named = build_network(CONFIG, 4).state_dict()
    weights = {f"average.{name}": weight.contiguous() for name, weight in named.items()}
    metadata = {"state": json.dumps(state)}
    (run / "checkpoint.safetensors").write_bytes(save(weights, metadata))
    card = publish(Options(run, output, replace=True, games=1), threading.Event())
    told = [card[name] for name in ("agent_steps", "updates", "wall_seconds")]
    assert told == [14_000, 3_500, 70.5]
    (run / "checkpoint.safetensors").write_bytes(save(weights, {"state": "{}"}))
    with pytest.raises(InputError, match=r"checkpoint\.safetensors is damaged \('books'\): cont"):
        publish(Options(run, output, replace=True, games=1), threading.Event())


def test_the_last_weights_are_published_unless_the_best_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("learner.publish.evaluate", lambda *given, name: {})
    run = _run(tmp_path / "small")
    best, last = (run / name for name in ("snapshots/best.safetensors", "checkpoint.safetensors"))
    other = build_network(CONFIG, 4)
    torch.nn.init.ones_(other.actions.weight)
    last.write_bytes(encode_weights(other))
    found = {}
    for name, chosen in (("last", False), ("best", True)):
        card = publish(Options(run, tmp_path / name, best=chosen), threading.Event())
        weights = (tmp_path / f"{name}.safetensors").read_bytes()
        found[name] = decode_network_file(weights)
        assert (card["agent_steps"], "snapshot" in card) == (19_000 if chosen else 12_345, chosen)
    for name, file in (("last", last), ("best", best)):
        expected = decode_network_file(file.read_bytes())["actions.weight"].half()
        assert torch.equal(found[name]["actions.weight"].half(), expected)
    assert not torch.equal(found["last"]["actions.weight"], found["best"]["actions.weight"])


def test_a_policy_that_is_there_is_replaced_only_if_asked(tmp_path: Path) -> None:
    run, output = _run(tmp_path / "small"), tmp_path / "policy"
    for file in (output.with_suffix(".safetensors"), output.with_suffix(".json")):
        file.write_text("another")
        with pytest.raises(InputError, match=rf"^{file} is there already: add --replace, or name"):
            publish(Options(run, output, best=True), threading.Event())
        assert file.read_text() == "another"
        file.unlink()
    output.with_suffix(".safetensors").write_text("another")
    card = publish(Options(run, output, replace=True, games=1, best=True), threading.Event())
    published = output.with_suffix(".safetensors").read_bytes()
    assert hashlib.sha256(published).hexdigest() == card["sha256"]


def test_best_weights_without_their_card_are_told(tmp_path: Path) -> None:
    (_run(tmp_path / "small") / "snapshots/best.json").unlink()
    with pytest.raises(InputError, match=r"best\.json does not exist"):
        publish(
            Options(run=tmp_path / "small", output=tmp_path / "policy", best=True),
            threading.Event(),
        )


def test_weights_of_another_test_than_their_cards_are_refused(tmp_path: Path) -> None:
    run, output = _run(tmp_path / "small"), tmp_path / "policy"
    weights = run / "snapshots/best.safetensors"
    Snapshots(run / "snapshots").keep_as_best(7, weights.read_bytes(), {"mean_score": 9.0})
    other = build_network(CONFIG, 4)
    torch.nn.init.zeros_(other.actions.weight)
    weights.write_bytes(encode_weights(other))  # as by a backup in between
    with pytest.raises(
        InputError, match=r"best\.safetensors is not of the test in .*best\.json: c"
    ):
        publish(Options(run=run, output=output, best=True), threading.Event())
    assert not list(tmp_path.glob("policy.*"))


@pytest.mark.parametrize(
    ("file", "content", "told"),
    [
        ("summary.json", '{"run": "r", "agent_steps": 1}', "earlier version, without updates"),
        ("summary.json", '{"run": "r"', "damaged"),
        ("summary.json", "[]", "damaged"),
        ("snapshots/best.json", "[" * 100_000, "damaged"),
        ("snapshots/best.safetensors", "no weights", "damaged"),
    ],
)
def test_a_run_that_tells_too_little_of_itself_is_refused_before_anything_is_written(
    tmp_path: Path, file: str, content: str, told: str
) -> None:
    run, output = _run(tmp_path / "small"), tmp_path / "policy"
    (run / file).write_text(content)
    with pytest.raises(InputError, match=rf"{file} is .*{told}.*: continue the run with --resume"):
        publish(Options(run=run, output=output, best=True), threading.Event())
    assert not list(tmp_path.glob("policy.*"))


def test_a_policy_that_was_not_evaluated_to_the_end_is_told(tmp_path: Path) -> None:
    stop = threading.Event()
    stop.set()
    output = tmp_path / "policy"
    with pytest.raises(InputError, match="publish again") as told:
        publish(Options(run=_run(tmp_path / "small"), output=output, games=2, best=True), stop)
    assert told.value.exit_code == INTERRUPTED
    assert [each.name for each in tmp_path.iterdir()] == ["small"]


@pytest.mark.parametrize("card", ["{", "[" * 100_000], ids=["damaged", "nested without end"])
def test_a_card_that_cannot_be_read_is_told(card: str, tmp_path: Path) -> None:
    (tmp_path / "policy.json").write_text(card)
    with pytest.raises(InputError, match=r"policy\.json is not JSON"):
        playing_settings(tmp_path / "policy.safetensors")


def test_a_card_without_games_is_refused_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "small"
    arguments = [str(_run(tmp_path / "run")), "-o", str(output), "--games", "0"]
    monkeypatch.setattr("sys.argv", ["publish", *arguments])
    with pytest.raises(InputError, match="games"):
        main()
    assert not list(tmp_path.glob("small.*"))

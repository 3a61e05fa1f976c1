"""`benchmarks.lab.robustness`: a grid of worlds, played once each."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from benchmarks.lab import robustness
from benchmarks.lab.policy import evaluate
from benchmarks.lab.robustness import OPTICS, cell_flags
from benchmarks.report import run
from common.command_line.parser import flag_in
from common.command_line.played import parse_played
from common.errors import InputError
from common.settings.config import RunConfig
from common.settings.ranges import RandomiseConfig
from learner.evaluation.__main__ import Evaluation
from tests.actors.robots.latency_model.models import drawn, saved
from tests.paths import ROOT

POLICY = ROOT / "policies" / "robot_pong_pixels.safetensors"
"""One that plays with any robot's hands."""


def played(flags: Sequence[str], policy: Path = POLICY) -> RunConfig:
    return parse_played(Evaluation, "learner.evaluation", [str(policy), *flags]).config()


def test_the_first_cell_is_the_world_of_the_training() -> None:
    assert played(cell_flags(0, "nominal", 0.0)) == played([])


def test_a_cell_adds_its_own_latency_and_optics() -> None:
    config = played(cell_flags(12, "grain", 0.25))
    assert (config.play.actuation_latency, config.play.sticky) == (12, 0.25)
    assert (config.camera.noise, config.camera.blur) == (8, 1)
    assert (config.camera.dropped, config.randomise) == (0, RandomiseConfig())
    moved = played(cell_flags(0, "pose", 0.0)).randomise
    assert (moved.head_pose, moved.screen_distance) == (5, 0.15)
    light = played(cell_flags(0, "light", 0.0)).randomise
    assert (light.gamma, light.ambient, light.glare) == (1.6, 0.2, 0.3)
    late = played(cell_flags(0, "late", 0.0)).camera
    assert (late.dropped, late.latency, late.noise) == (0.1, 1, 0)


class Games:
    """Evaluations whose mean is 20, less the latency and 2 for noise; remembers its cells."""

    def __init__(self) -> None:
        self.network = POLICY
        self.flags: list[dict[str, str]] = []
        self.left = 10**6

    def __call__(
        self, network: Path, games: int, epsilon: float, flags: Sequence[str]
    ) -> dict[str, Any]:
        assert network == self.network
        if not self.left:
            raise KeyboardInterrupt
        self.left -= 1
        told = dict(zip(flags[::2], flags[1::2], strict=True))
        self.flags.append(told)
        mean = 20.0 - int(told["--play.actuation-latency"]) - float(told["--camera.noise"]) / 4
        return dict.fromkeys(robustness._KEPT, 0) | {"mean": mean, "deviation": 1.5}


@pytest.fixture
def games(monkeypatch: pytest.MonkeyPatch) -> Games:
    games = Games()
    monkeypatch.setattr(robustness, "evaluate", games)
    return games


def grid(file: Path, *flags: str, network: Path = POLICY) -> dict[str, Any]:
    arguments = [str(network), "--games", "3", "--json", str(file), *flags]
    run("lab.robustness", robustness.Options, robustness.measure, arguments)
    content: dict[str, Any] = json.loads(file.read_bytes())
    return content


def test_table_and_json(games: Games, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    content = grid(tmp_path / "grid.json", "--sticky", "0.25", "--seed", "4")
    assert len(content["cells"]) == 25
    assert all(each["--play.sticky"] == "0.25" and each["--seed"] == "4" for each in games.flags)
    means = {(cell["optics"], cell["latency"]): cell["mean"] for cell in content["cells"]}
    assert means["nominal", 0] == 20.0
    assert means["grain", 12] == 6.0
    assert set(means) == {(optics, late) for optics in OPTICS for late in (0, 2, 4, 8, 12)}
    assert content["rows"][1] == {
        "optics": "grain",
        **{
            f"+{ms} ms": f"{mean}.0 ± 1.5"
            for ms, mean in {0: 18, 33: 16, 67: 14, 133: 10, 200: 6}.items()
        },
    }
    said = " ".join(capsys.readouterr().out.split())
    assert "+200 ms" in said
    assert "mean of all cells 14.40, worst 6.00" in said  # 20 − 26 / 5 − 2 / 5


def test_a_file_from_before_there_were_flags_goes_on(games: Games, tmp_path: Path) -> None:
    file = tmp_path / "grid.json"
    content = grid(file, "--optics", "nominal")
    assert content.pop("flags") == ""
    file.write_text(json.dumps(content))
    games.left = 0
    assert grid(file, "--optics", "nominal")["cells"] == content["cells"]
    file.write_text(json.dumps(content))
    with pytest.raises(InputError, match="holds no grid"):
        grid(file, "--optics", "nominal", "--flags=--play.equal-latency 17")


def test_cells_of_other_settings_are_played_again(
    games: Games, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "grid.json"
    grid(file)
    noisier = OPTICS["grain"]._replace(settings={"camera.noise": "12", "camera.blur": "1"})
    monkeypatch.setitem(OPTICS, "grain", noisier)
    cells = grid(file)["cells"]
    assert (len(cells), len(games.flags)) == (25, 30)
    assert [cell["mean"] for cell in cells if cell["optics"] == "grain"] == [17, 15, 13, 9, 5]


def test_a_network_of_the_emulator_alone_is_told_at_once_what_it_can_play(
    games: Games, tmp_path: Path
) -> None:
    games.network = ROOT / "policies" / "ale_pong.safetensors"
    told = r"cannot play --optics pose \(.*--env ale.*\): give --optics nominal grain light late\."
    with pytest.raises(InputError, match=told):
        grid(tmp_path / "grid.json", network=games.network)
    assert not games.flags
    flags = "--optics", "nominal", "grain", "light", "late"
    assert len(grid(tmp_path / "grid.json", *flags, network=games.network)["cells"]) == 20


def test_an_error_of_all_cells_is_told_as_it_is(games: Games, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^there is no flag --camera\.fog"):
        grid(tmp_path / "grid.json", "--flags=--camera.fog 1")


def test_unknown_optics() -> None:
    with pytest.raises(InputError, match="there is no optics 'graln': did you mean grain"):
        run(
            "lab.robustness",
            robustness.Options,
            robustness.measure,
            [f"{POLICY}", "--optics", "graln"],
        )


def test_a_cell_is_the_same_for_all_networks() -> None:
    odd = ["--camera.red", "0.5", "--play.arm-speed", "0.4", "--play.actuation-jitter", "2"]
    for optics in OPTICS:
        assert played([*odd, *cell_flags(4, optics, 0.0)]) == played(cell_flags(4, optics, 0.0))


def test_the_page_tells_the_optics() -> None:
    page = (ROOT / "docs" / "conditions.md").read_text(encoding="utf-8")
    for name, optics in OPTICS.items():
        flags = " ".join(f"--{setting} {value}" for setting, value in optics.settings.items())
        cells = f"| `{name}`: {optics.title} | {f'`{flags}` ' if flags else ''}|"
        assert cells in page


def test_an_interrupted_grid_goes_on(games: Games, tmp_path: Path) -> None:
    file = tmp_path / "grid.json"
    games.left = 7
    with pytest.raises(KeyboardInterrupt):
        grid(file)
    assert len(json.loads(file.read_bytes())["cells"]) == 7
    games.left = 18
    content = grid(file)
    assert len(content["cells"]) == 25
    assert len(games.flags) == 25
    assert len({json.dumps(each, sort_keys=True) for each in games.flags}) == 25
    games.left = 1
    with pytest.raises(KeyboardInterrupt):
        grid(file, "--latencies", "1", "3")
    left = json.loads(file.read_bytes())
    assert (len(left["cells"]), "rows" in left) == (26, False)  # those before have no +17 ms


def test_the_card_is_told_mean_and_worst_of_a_grid(games: Games, tmp_path: Path) -> None:
    games.network = Path(shutil.copy(POLICY, tmp_path / "p.safetensors"))
    file = tmp_path / "grid.json"
    with pytest.raises(InputError, match=r"p\.safetensors has no card: publish it"):
        grid(file, "--card", network=games.network)
    with pytest.raises(
        InputError, match="--card needs the whole grid with the policy's own robot: omit"
    ):
        grid(file, "--card", "--latencies", "0", "2", network=games.network)
    assert not games.flags
    card = json.loads(POLICY.with_suffix(".json").read_bytes())
    (tmp_path / "p.json").write_text(json.dumps(card))
    grid(file, network=games.network)
    assert json.loads((tmp_path / "p.json").read_bytes()) == card
    grid(file, "--card", network=games.network)
    assert len(games.flags) == 25  # nothing was played again
    told = json.loads((tmp_path / "p.json").read_bytes())
    assert told.pop("grid") == {
        "worlds": 25, "games": 3, "mean": 14.4, "worst": 6.0, "added_ms": 200.0
    }  # fmt: skip
    assert told == card
    (tmp_path / "p.json").write_text(json.dumps(card | {"sha256": "0" * 64}))
    with pytest.raises(InputError, match=r"p\.json is not the card of p\.safetensors"):
        grid(file, "--card", network=games.network)


def test_another_robot_may_play(games: Games, tmp_path: Path) -> None:
    content = grid(tmp_path / "grid.json", "--robot", "robotroller", "--optics", "nominal")
    assert content["network"] == f"{POLICY.stem} by robotroller"
    assert {each["--play.robot"] for each in games.flags} == {"robotroller"}
    flags = cell_flags(0, "nominal", 0.0, "robotroller")
    assert played(flags).play.robot == "robotroller"
    games.network = POLICY.with_stem("robot_pong")
    with pytest.raises(InputError, match="give --robot nao"):  # it was told NAO's joints
        grid(tmp_path / "joints.json", "--robot", "robotroller", network=games.network)
    with pytest.raises(InputError, match="with the policy's own robot: omit"):
        grid(tmp_path / "card.json", "--card", "--robot", "robotroller")
    with pytest.raises(InputError, match="robotrolla"):
        grid(tmp_path / "none.json", "--robot", "robotrolla")


def test_other_settings_may_be_given_for_all_cells(games: Games, tmp_path: Path) -> None:
    content = grid(tmp_path / "grid.json", "--flags=--play.equal-latency 17", "--optics", "nominal")
    assert content["flags"] == "--play.equal-latency 17"
    assert {each["--play.equal-latency"] for each in games.flags} == {"17"}
    zero = grid(tmp_path / "zero.json", "--flags=--play.max-game-frames 0", "--optics", "nominal")
    assert zero["flags"] == "--play.max-game-frames 0"  # a value that cells have too is no flag
    for own in (
        "--camera.noise=3",
        "--play.actuation_latency 3",
        "--seed 2",
        "--headline",
        "--play.robot nao",
        "--robot nao",
    ):
        with pytest.raises(InputError, match=rf"^--flags names {flag_in(own.split()[0])}, wh"):
            grid(tmp_path / "refused.json", f"--flags={own}")
    with pytest.raises(InputError, match=r"^--flags is \"'\" \(No closing quotation\): quote it"):
        grid(tmp_path / "refused.json", "--flags='")
    with pytest.raises(InputError, match=r"whole grid .*--robot, --flags"):
        grid(tmp_path / "card.json", "--card", "--flags=--play.equal-latency 17")


def test_a_card_is_told_no_grid_with_more_random_actions(games: Games, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"whole grid .*--flags, --epsilon\.$"):
        grid(tmp_path / "card.json", "--card", "--epsilon", "0.05")


@pytest.mark.parametrize(
    "other",
    [
        ("--sticky", "0.5"),
        ("--seed", "2"),
        ("--games", "4"),
        ("--epsilon", "0.05"),
        ("--robot", "robotroller"),
        ("--flags=--play.equal-latency 17",),
    ],
)
def test_a_file_of_another_grid_is_refused(
    games: Games, tmp_path: Path, other: tuple[str, ...]
) -> None:
    file = tmp_path / "grid.json"
    one = ("--latencies", "0", "--optics", "nominal")
    grid(file, *one)
    before = file.read_bytes()
    with pytest.raises(InputError, match="holds no grid of this network"):
        grid(file, *one, *other)
    assert file.read_bytes() == before
    grid(tmp_path / "other.json", *one, *other)
    with pytest.raises(InputError, match="holds no grid of this network"):
        grid(tmp_path / "other.json", *one)
    for cells in (3, [{"optics": "nominal", "latency": 0}], ["nominal"]):
        file.write_text(json.dumps(json.loads(before) | {"cells": cells}))
        with pytest.raises(InputError, match="holds no cells of a grid"):
            grid(file, *one)
    for junk in (b"[]", b"{}", b"no JSON"):  # of no benchmark at all
        file.write_bytes(junk)
        with pytest.raises(InputError, match="holds no earlier results"):
            grid(file, *one)


def test_a_grid_of_another_network_of_the_same_name_is_refused(
    games: Games, tmp_path: Path
) -> None:
    games.network = Path(shutil.copy(POLICY, tmp_path / "p.safetensors"))
    shutil.copy(POLICY.with_suffix(".json"), tmp_path / "p.json")
    file, one = tmp_path / "grid.json", ("--latencies", "0", "--optics", "nominal")
    grid(file, *one, network=games.network)
    shutil.copy(POLICY.with_stem("robot_pong_pixels_safe"), games.network)
    with pytest.raises(InputError, match="holds no grid of this network"):
        grid(file, *one, network=games.network)


@pytest.mark.parametrize(
    "flags",
    [
        ["--robot", "{}"],
        ["--flags=--play.equal-latency 17 --play.hands-model {}"],
    ],
)
def test_a_grid_by_another_model_in_the_same_file_is_refused(
    flags: list[str], games: Games, tmp_path: Path
) -> None:
    model, file = tmp_path / "hands.npz", tmp_path / "grid.json"
    one = ["--latencies", "0", "--optics", "nominal", *(flag.format(model) for flag in flags)]
    saved(model, drawn(8, 1))
    grid(file, *one)
    saved(model, drawn(8, 2))
    with pytest.raises(InputError, match="holds no grid of this network"):
        grid(file, *one)


@pytest.mark.usefixtures("forks")
def test_a_cell_is_played_for_real() -> None:
    flags = [*cell_flags(2, "late", 0.25), "--play.max-game-frames", "80"]
    told = evaluate(POLICY, 1, 1.0, flags)
    assert 0 < told["steps_of_games"][0] <= 20 + 30
    assert all(name in told for name in robustness._KEPT)

"""What the figures show, read back from their axes."""

import csv
import inspect
import io
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure

from benchmarks.figures.plot import FIGURES
from benchmarks.figures.plot import Options as ResultOptions
from benchmarks.figures.plot_hand_latency import read_hand_latency
from benchmarks.figures.plot_robustness import Grid, robustness_figure
from benchmarks.lab import hand_latency
from common.errors import InputError
from common.run.epochs import EpochTable
from common.settings.presets import PRESETS
from common.settings.stored_config import to_json
from learner.figures.plot import Options, main
from learner.figures.plot_histogram import read_evaluations
from learner.figures.plot_runs import read_groups
from learner.figures.plot_style import RANDOM, line_figure, mean_line, save
from tests.epoch_rows import epoch_row
from tests.full_disk import files_of_at_most
from tests.paths import ROOT

ROW = epoch_row()


@pytest.fixture(autouse=True)
def nothing_stays_open() -> Iterator[None]:
    yield
    plt.close("all")


def draw(options: Options) -> Figure:
    return FIGURES[options.figure](options)


def table(path: Path, rewards: Sequence[float], random: float = -20.5, hour: float = 1.0) -> Path:
    """A table of 1,000,000 steps and one hour an epoch; max-Q is a hundredth of the reward."""
    rows = EpochTable(path)
    rows.append(replace(ROW, average_reward=random, meanq=9.0))
    for epoch, reward in enumerate(rewards, 1):
        done = replace(
            ROW,
            epoch=epoch,
            phase="train",
            total_train_steps=epoch * 1_000_000,
            average_reward=-99.0,
            meanq=reward / 100,
            total_time=3_600 * hour * (epoch - 0.25),
        )
        rows.append(done)
        tested = replace(done, phase="test", average_reward=reward, total_time=3_600 * hour * epoch)
        rows.append(tested)
    return path


def run(folder: Path, seed: int, rewards: Sequence[float], n_step: int = 3, **more: float) -> Path:
    folder.mkdir()
    config = replace(
        PRESETS["fast"], seed=seed, learning=replace(PRESETS["fast"].learning, n_step=n_step)
    )
    (folder / "config.json").write_text(json.dumps(asdict(config)))
    table(folder / "epochs.csv", rewards, **more)
    return folder


def lines(axes: Axes) -> list[list[tuple[float, float]]]:
    """Points of each line but the random policy's."""
    found = [line for line in axes.get_lines() if to_hex(str(line.get_color())) != RANDOM]
    return [[(x, y) for x, y in np.asarray(line.get_xydata()).tolist()] for line in found]


def reds(axes: Axes) -> list[float]:
    """Heights of the lines of the random policy."""
    return [
        float(np.asarray(line.get_ydata())[0])
        for line in axes.get_lines()
        if to_hex(str(line.get_color())) == RANDOM
    ]


def names(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_epochs_have_reward_random_policy_and_max_q(tmp_path: Path) -> None:
    figure = draw(Options((table(tmp_path / "pong.csv", [-20.0, -10.0, 18.5]),)))
    rewards, values = figure.axes
    assert lines(rewards) == [[(1, -20.0), (2, -10.0), (3, 18.5)]]
    assert reds(rewards) == [-20.5]
    assert lines(values) == [[(1, -0.2), (2, -0.1), (3, 0.185)]]
    assert reds(values) == []
    assert names(figure) == ["pong", "random policy, −20.5"]


@pytest.mark.parametrize("parts", [0, 2, 5, 9])
def test_a_legend_has_room(tmp_path: Path, parts: int) -> None:
    paths = (tmp_path / f"{name}{'-R5-pong' * parts}.csv" for name in "abcd")
    tables = tuple(table(path, [-20.0]) for path in paths)
    figure = draw(Options(tables, figure="progress"))
    figure.canvas.draw()
    found = figure.legends[0].get_window_extent()
    assert 0 <= found.x0 < found.x1 <= figure.bbox.width


def test_rewards_can_be_those_of_the_training(tmp_path: Path) -> None:
    path = table(tmp_path / "pong.csv", [-20.0, 18.5])
    figure = draw(Options((path,), phase="train"))
    assert lines(figure.axes[0]) == [[(1, -99.0), (2, -99.0)]]
    assert "training" in figure.axes[0].get_ylabel()
    assert "tests" in draw(Options((path,))).axes[0].get_ylabel()


@pytest.mark.parametrize(("meanq", "told"), [(0.5, ["pong"]), (None, None)])
def test_a_run_in_which_no_game_has_ended_is_drawn_without_rewards(
    tmp_path: Path, meanq: float | None, told: list[str] | None
) -> None:
    path = tmp_path / "pong.csv"
    EpochTable(path).append(replace(epoch_row((), phase="train", epoch=1), meanq=meanq))
    figure = draw(Options((path,)))
    assert [lines(axes) for axes in figure.axes] == [[], [[(1, 0.5)]] if meanq else []]
    assert (names(figure) if figure.legends else None) == told
    assert not draw(Options((path,), figure="progress")).legends


def test_the_tables_of_2017_are_drawn(tmp_path: Path) -> None:
    path = tmp_path / "pong_sync.csv"
    header = ",".join(ROW.__dataclass_fields__)
    path.write_bytes(
        "\r\n".join(
            (
                header,
                "0,random,50000,54,-20.185185,-21,-17,1,0,50000,0.0,0,0,2336.5,2336.5,21.3",
                "1,train,250000,277,-20.2563,-21,-17,0.8875,250000,300000,-0.406506,0.0038,"
                "62500,15505.6,13168.2,18.9",
                "1,test,125000,167,-21.0,-21,-21,0.05,250000,300000,-0.406506,0,62500,20895.4,"
                "5389.7,23.1",
                "",
            )
        ).encode()
    )
    rewards, values = draw(Options((path,))).axes
    assert (lines(rewards), lines(values)) == ([[(1, -21.0)]], [[(1, -0.406506)]])
    assert reds(rewards) == [-20.185185]


def test_progress_is_over_steps_and_wall_clock(tmp_path: Path) -> None:
    path = table(tmp_path / "a.csv", [-20.0, -10.0, 5.0, 18.0])
    by_steps, by_time = draw(Options((path,), figure="progress")).axes
    assert lines(by_steps) == [[(1, -20.0), (2, -10.0), (3, 5.0), (4, 18.0)]]
    assert lines(by_time) == [[(1, -20.0), (2, -10.0), (3, 5.0), (4, 18.0)]]
    assert by_steps.get_xlabel() == "agent steps of training (millions)"
    assert by_time.get_xlabel() == "wall clock (hours)"
    assert (reds(by_steps), reds(by_time)) == ([-20.5], [-20.5])


def test_seeds_are_thin_lines_and_their_mean_a_thick_one(tmp_path: Path) -> None:
    first = run(tmp_path / "pong-1", 1, [-20.0, -10.0, 0.0], random=-20.5)
    second = run(tmp_path / "pong-2", 2, [-18.0, -6.0], random=-20.1)
    other = run(tmp_path / "other", 1, [-21.0], n_step=5, random=-20.3)
    figure = draw(Options((first, other, second)))
    rewards = figure.axes[0]
    assert lines(rewards) == [
        [(1, -20.0), (2, -10.0), (3, 0.0)],
        [(1, -18.0), (2, -6.0)],
        [(1, -19.0), (2, -8.0)],  # where both are
        [(1, -21.0)],
    ]
    widths = [line.get_linewidth() for line in rewards.get_lines()[:4]]
    assert widths[0] == widths[1] < widths[2] == widths[3]
    assert reds(rewards) == [pytest.approx(-20.3)]
    assert names(figure) == ["pong, mean of 2 seeds", "other", "random policy, −20.5 to −20.1"]


def test_a_reward_that_is_rounded_to_0_has_no_sign(tmp_path: Path) -> None:
    paths = [
        run(tmp_path / f"a-{at}", at, [1.0], random=each) for at, each in enumerate((-0.004, 0))
    ]
    assert names(draw(Options(tuple(paths))))[-1] == "random policy, 0.00"


def test_other_modes_are_other_runs(tmp_path: Path) -> None:
    paths = tuple(run(tmp_path / f"pong-{seed}", seed, [-20.0]) for seed in (1, 2))
    for path, sync in zip(paths, (True, False), strict=True):
        (path / "summary.json").write_text(json.dumps({"sync": sync}))
    assert names(draw(Options(paths)))[:2] == ["pong-1", "pong-2"]


def test_a_summary_is_read_whatever_the_locale(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(io, "text_encoding", lambda given, level=2: given or "ascii")
    path = run(tmp_path / "pong", 1, [-20.0])
    (path / "summary.json").write_text('{"gates": "≥ 0.99"}', "utf-8")
    assert names(draw(Options((path,))))[0] == "pong"


def test_a_run_that_was_given_a_network_is_no_seed_of_a_fresh_one(tmp_path: Path) -> None:
    paths = tuple(run(tmp_path / f"pong-{seed}", seed, [-20.0]) for seed in (1, 2))
    (paths[1] / "initial.safetensors").touch()
    assert names(draw(Options(paths)))[:2] == ["pong-1", "pong-2"]


def test_tables_belong_together_by_their_names(tmp_path: Path) -> None:
    stems = ("r5_seed1", "r5_seed2", "r6_1", "r6_2")
    paths = tuple(table(tmp_path / f"{stem}.csv", [-20.0]) for stem in stems)
    assert names(draw(Options(paths)))[:-1] == ["r5, mean of 2 seeds", "r6_1", "r6_2"]


def test_tables_of_one_name_in_two_folders_are_two_runs(tmp_path: Path) -> None:
    for name in ("pong", "breakout"):
        (tmp_path / name).mkdir()
    paths = tuple(table(tmp_path / f"{name}/epochs.csv", [1.0]) for name in ("pong", "breakout"))
    assert len(lines(draw(Options(paths)).axes[0])) == 2


def test_seeds_have_no_mean_by_the_clock(tmp_path: Path) -> None:
    paths = tuple(run(tmp_path / f"pong-{seed}", seed, [-20.0, -10.0]) for seed in (1, 2))
    by_steps, by_time = draw(Options(paths, figure="progress")).axes
    assert [len(lines(axes)) for axes in (by_steps, by_time)] == [3, 2]


def test_without_tests_training_is_drawn_and_said(tmp_path: Path) -> None:
    rows = EpochTable(tmp_path / "a.csv")
    rows.append(replace(ROW, epoch=1, phase="train", average_reward=-19.0))
    rows.append(replace(ROW, epoch=2, phase="train", average_reward=None))
    rewards, _ = draw(Options((tmp_path / "a.csv",))).axes
    assert lines(rewards) == [[(1, -19.0)]]
    assert rewards.get_ylabel() == "average reward of a game (training)"


def test_means_are_straight_between_points() -> None:
    found = mean_line([np.array([[0.0, 0.0], [4.0, 8.0]]), np.array([[1.0, 2.0], [6.0, 2.0]])])
    assert found.tolist() == [[1.0, 2.0], [4.0, 5.0]]


def late(path: Path, *rows: tuple[str, int, float]) -> Path:
    """A table of networks, presses and means."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, hand_latency.COLUMNS)
        writer.writeheader()
        for row in rows:
            writer.writerow(dict(zip(("network", "press", "mean"), row, strict=True)))
    return path


def test_the_table_of_a_former_commit_is_drawn() -> None:
    """It has no column git_dirty."""
    played = read_hand_latency([ROOT / "benchmarks" / "results" / "hand_latency.csv"])
    assert len(played) == 10
    assert max(each.late_ms for each in played) == pytest.approx(4 * 1000 / 60)


def test_networks_under_later_keys_are_a_line_each(tmp_path: Path) -> None:
    path = late(tmp_path / "late.csv", ("a", 3, -5.0), ("b", 0, 19.0), ("a", 0, 20.0))
    figure = draw(Options((path,), figure="latency"))
    found = lines(figure.axes[0])
    assert [[y for _, y in line] for line in found] == [[20.0, -5.0], [19.0]]
    assert [x for x, _ in found[0]] == pytest.approx([0.0, 50.0])
    assert names(figure) == ["a", "b"]


def test_rates_against_actors() -> None:
    published = ROOT / "benchmarks" / "results" / "scaling.json"
    figure = draw(Options((published,), figure="scaling"))
    found = json.loads(published.read_text())["scaling"]
    assert names(figure) == [
        "training, evaluator idle",
        "training beside a test",
        "a test beside training",
    ]
    for line, rate in zip(
        lines(figure.axes[0]),
        (
            "train_steps_per_second",
            "train_steps_per_second_beside_test",
            "test_steps_per_second_beside_training",
        ),
        strict=True,
    ):
        assert line == [(each["actors"], each[rate]) for each in found]


def evaluation(path: Path, scores: list[float]) -> Path:
    found = {"scores": scores, "mean": 17.5, "deviation": 2.0, "iqm": 18.25}
    path.write_text(json.dumps(found))
    return path


def test_each_score_has_a_bar(tmp_path: Path) -> None:
    first = evaluation(tmp_path / "a.json", [-21.0, 18.0, 18.0, 21.0])
    second = evaluation(tmp_path / "b.json", [20.0])
    above, below = draw(Options((first, second), figure="histogram")).axes

    def bars(axes: Axes) -> dict[float, float]:
        return {
            bar.get_x() + bar.get_width() / 2: bar.get_height()  # type: ignore[attr-defined]
            for bar in axes.patches
            if bar.get_height()  # type: ignore[attr-defined]
        }

    # The axis leaves out most of what lies between −21 and 18.
    names = dict(
        zip(below.get_xticks(), (t.get_text() for t in below.get_xticklabels()), strict=True)
    )
    assert names == {0.0: "−21", 1.5: "…", 3.0: "18", 5.0: "20", 6.0: "21"}
    assert bars(above) == {0.0: 1, 3.0: 2, 6.0: 1}
    assert bars(below) == {5.0: 1}
    (mean,) = above.collections
    assert isinstance(mean, LineCollection)
    place = pytest.approx(3 * 38.5 / 39)
    assert mean.get_segments()[0].tolist() == [[place, 0], [place, 2]]  # below the bars' labels
    assert above.get_title(loc="left") == (
        "a\n4 games, mean 17.50 ± 2.00 (line), interquartile mean 18.25"
    )


def test_a_legend_has_words_instead_of_the_names_of_files(tmp_path: Path) -> None:
    paths = tuple(table(tmp_path / f"{name}.csv", [1.0]) for name in ("a-seed-1", "a-seed-2", "b"))
    drawn = draw(Options(paths, names=("the robot", "the emulator")))
    assert names(drawn)[:2] == ["the robot, mean of 2 seeds", "the emulator"]
    with pytest.raises(InputError, match="3 names for 2 lines"):
        draw(Options(paths, names=("one", "two", "three")))
    with pytest.raises(InputError, match=r"2 names for 1 line \(b\): give"):
        draw(Options(paths[2:], names=("one", "two")))


@pytest.mark.parametrize("name", ["f.png", "f.svg", "f.pdf"])
def test_a_figure_for_which_there_is_no_room_leaves_the_earlier_one(
    tmp_path: Path, name: str
) -> None:
    path = tmp_path / name
    path.write_text("an earlier figure")
    with files_of_at_most(4096), pytest.raises(InputError, match=f"{name} cannot be written"):
        save(line_figure([], "x", "y", width=4, height=3)[0], path)
    assert path.read_text() == "an earlier figure"
    assert list(tmp_path.iterdir()) == [path]
    save(line_figure([], "x", "y", width=4, height=3)[0], path)
    signs = {"f.png": b"\x89PNG", "f.svg": b"<?xml", "f.pdf": b"%PDF"}
    assert path.read_bytes().startswith(signs[name])


def test_every_figure_is_in_the_help() -> None:
    told = inspect.getsource(ResultOptions)
    assert all(f"'{name}'" in told for name in FIGURES)


def test_the_press_latency_is_drawn_from_its_file(tmp_path: Path) -> None:
    file = tmp_path / "press.json"
    found = {"actions": ["·", "F"], "table_ms": [[None, 50.0], [100 / 6, None]]}
    file.write_text(json.dumps({**found, "p50_ms": 50.0, "p99_ms": 66.7}))
    axes, bar = draw(Options((file,), figure="press")).axes
    assert [text.get_text() for text in axes.texts] == ["50", "17"]
    assert [text.get_text() for text in axes.get_xticklabels()] == ["none", "F"]
    assert [text.get_text() for text in bar.get_yticklabels()] == ["17 ms", "33 ms", "50 ms"]
    for useless in ({}, {**found, "table_ms": [[None] * 2] * 2, "p50_ms": None, "p99_ms": None}):
        file.write_text(json.dumps(useless))
        with pytest.raises(InputError, match="holds no press latency"):
            draw(Options((file,), figure="press"))


def test_wide_ranges_have_fewer_bars(tmp_path: Path) -> None:
    (axes,) = draw(
        Options((evaluation(tmp_path / "a.json", [0.0, 5_000.0]),), figure="histogram")
    ).axes
    assert len(axes.patches) == 30
    assert sum(bar.get_height() for bar in axes.patches) == 2  # type: ignore[attr-defined]


def test_the_card_of_a_policy_has_a_histogram() -> None:
    card = ROOT / "policies" / "ale_pong.json"
    headline = ("ε = 0.001, sticky 0", "ε = 0.05, sticky 0", "ε = 0.001, sticky 0.25")
    names = [each.name for each in read_evaluations(card)]
    assert names == [f"ale_pong, {chance}" for chance in headline]


def test_a_headline_has_a_histogram_for_each_of_its_evaluations(tmp_path: Path) -> None:
    figures = {"mean": 1.0, "deviation": 0.0, "iqm": 1.0}
    chances = ((0.001, 0.0, [20.0]), (0.05, 0.0, [16.0]), (0.001, 0.25, [4.0, 5.0]))
    rows = [
        {"epsilon": epsilon, "sticky": sticky, "scores": scores, **figures}
        for epsilon, sticky, scores in chances
    ]
    file = tmp_path / "pong.json"
    file.write_text(json.dumps({"weights": "pong", "rows": rows}))
    axes = draw(Options((file,), figure="histogram")).axes
    assert [each.get_title(loc="left").splitlines()[0] for each in axes] == [
        "pong, ε = 0.001, sticky 0",
        "pong, ε = 0.05, sticky 0",
        "pong, ε = 0.001, sticky 0.25",
    ]
    assert "2 games" in axes[2].get_title(loc="left")


def robustness(path: Path, optics: Sequence[str], means: Sequence[float]) -> Path:
    """A grid over 0 and 100 ms."""
    places = [(each, added) for each in optics for added in (0.0, 100.0)]
    cells = [
        {"optics": each, "added_ms": added, "mean": mean}
        for (each, added), mean in zip(places, means, strict=True)
    ]
    about = {"network": "a", "epsilon": 0.001, "sticky": 0.25, "cells": cells}
    path.write_text(json.dumps(about))
    return path


def test_scores_in_a_heat_map_stand_out_from_every_colour() -> None:
    optics, scores = ["nominal", "late"], np.linspace(-21.0, 21.0, 43)
    means = {(each, float(score)): float(score) for each in optics for score in scores}
    axes = robustness_figure([Grid("all", optics, scores.tolist(), means)]).axes[0]
    (image,) = axes.get_images()
    assert len(axes.texts) == len(optics) * len(scores)
    for text in axes.texts:
        cell = image.to_rgba(scores[int(text.get_position()[0])])
        shades = [_luminance([*colour[:3]]) + 0.05 for colour in (to_rgba(text.get_color()), cell)]
        assert max(shades) / min(shades) > 3, text.get_text()  # as WCAG asks of figures


def _luminance(colour: Sequence[float]) -> float:
    """Returns the relative luminance of an sRGB colour, as in WCAG 2."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour]
    return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))


def test_a_grid_is_a_heat_map(tmp_path: Path) -> None:
    # The worst cells were played first, as by --optics late before all of them.
    path = robustness(tmp_path / "a.json", ["late", "nominal"], [-1.0, -21.0, 20.0, 3.5])
    axes, _ = draw(Options((path,), figure="robustness")).axes
    (image,) = axes.get_images()
    assert np.asarray(image.get_array()).tolist() == [[20.0, 3.5], [-1.0, -21.0]]
    assert image.get_clim() == (-21.0, 21.0)
    assert [text.get_text() for text in axes.texts] == ["20.0", "3.5", "−1.0", "−21.0"]
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["0", "100"]
    assert [tick.get_text() for tick in axes.get_yticklabels()] == [
        "a perfect camera",
        "pictures lost and late",
    ]
    assert axes.get_title(loc="left") == "a, ε = 0.001, sticky 0.25"


def test_grids_of_one_optics_are_curves(tmp_path: Path) -> None:
    one = robustness(tmp_path / "a.json", ["nominal"], [20.0, 3.5])
    other = robustness(tmp_path / "b.json", ["nominal"], [18.0, 17.0])
    (axes,) = draw(Options((one, other), figure="robustness")).axes
    assert lines(axes) == [[(0.0, 20.0), (100.0, 3.5)], [(0.0, 18.0), (100.0, 17.0)]]


def test_a_run_is_drawn_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("runs").mkdir()
    run(Path("runs/first"), 1, [1.0, 2.0])
    monkeypatch.setattr("sys.argv", ["plot", "first", "-o", "first.png"])
    main()
    assert Path("first.png").stat().st_size > 1_000
    Path("first").touch()  # a file of that name is meant rather
    with pytest.raises(InputError, match="is not a table of epochs"):
        main()


def test_what_cannot_be_drawn_is_refused(tmp_path: Path) -> None:
    here = tmp_path / "a.csv"
    for paths, output, words in (
        ((), "a.png", "nothing to draw"),
        ((here,), "a.png", "does not exist"),
        ((tmp_path,), "a.bmp", "is not a picture's name"),
    ):
        with pytest.raises(InputError, match=words):
            Options(paths, tmp_path / output).check(FIGURES)


def test_files_of_another_kind_are_refused(tmp_path: Path) -> None:
    text = tmp_path / "a.txt"
    text.write_text("epoch\n")
    endless = tmp_path / "endless.json"
    damaged = run(tmp_path / "run", 1, [1.0])
    for file in (endless, damaged / "config.json"):
        file.write_text("[" * 100_000)
    empty = tmp_path / "empty.csv"
    EpochTable(empty).append(ROW)
    broken = late(tmp_path / "broken.csv", ("a", 0, float("nan")))
    for figure, path, words in (
        ("epochs", text, "is not a table of epochs"),
        ("progress", empty, "no complete epoch"),
        ("epochs", tmp_path, "holds no run: name a run's folder or"),
        ("latency", text, "is not a table of"),
        ("latency", empty, "is not a table of"),
        ("latency", late(tmp_path / "headed.csv"), "is not a table of"),
        ("latency", broken, "damaged in row 1"),
        ("histogram", text, "holds no evaluation"),
        ("histogram", endless, "holds no evaluation"),
        ("epochs", damaged, r"config\.json cannot be read"),
        ("histogram", tmp_path, r"holds no evaluation: write one with ale-robot evaluate"),
        ("scaling", text, "holds no scaling"),
        ("robustness", text, "holds no grid"),
        ("robustness", robustness(tmp_path / "no.json", [], []), "none of its cells"),
        ("robustness", robustness(tmp_path / "fog.json", ["fog"], [1.0, 2.0]), "holds no grid"),
        ("histogram", evaluation(tmp_path / "none.json", []), "has no scores"),
    ):
        with pytest.raises(InputError, match=words):
            draw(Options((path,), figure=figure))


def test_before_the_first_epoch_it_is_told_how_far_the_run_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    EpochTable(tmp_path / "epochs.csv").append(ROW)
    (tmp_path / "config.json").write_text(to_json(PRESETS["robot"]))
    with pytest.raises(InputError, match="no complete epoch yet: let the run go on"):
        read_groups([tmp_path])
    (tmp_path / "summary.json").write_text('{"agent_steps": 12345}')
    monkeypatch.chdir(tmp_path)
    for path in (tmp_path, Path(".")):
        with pytest.raises(InputError, match=r"epoch yet \(12,345 of 60,000 steps\): let"):
            read_groups([path])
    copied = tmp_path.rename(tmp_path.with_name("a copy (2)"))
    with pytest.raises(InputError, match="no complete epoch yet: let the run go on"):
        read_groups([copied])

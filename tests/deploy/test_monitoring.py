"""What Prometheus and Grafana are given: all figures that it names exist, and each alert fires."""

import json
import re
import subprocess
import urllib.request
from pathlib import Path

import pytest

from benchmarks.child import free_endpoint
from common.metrics import METRICS, Metric, Values
from common.process.http_endpoints import http_endpoints
from common.protocol.actor_stats import ActorStats
from common.protocol.run_status import HealthCheck
from deploy.grafana import DASHBOARD, OF_LEARNER, dashboard, flat, text
from learner.telemetry.sinks.prometheus import PrometheusSink
from learner.telemetry.snapshot import ActorView
from tests.deploy.prometheus import PROMETHEUS, panels_of, prometheus, tool
from tests.learner.telemetry.snapshots import snapshot


def names_in(text: str) -> set[str]:
    return set(re.findall(r"\bale_robot_\w+", text))


def told_names() -> set[str]:
    """Names of all figures of a learner."""
    found = {each.name for each in PrometheusSink().collect()}
    return found | {f"{name}_total" for name in found} | {f"{name}_info" for name in found}


@pytest.mark.parametrize("file", [PROMETHEUS / "alerts.yml", DASHBOARD], ids=lambda file: file.name)
def test_every_figure_that_is_named_exists(file: Path) -> None:
    named = names_in(file.read_text())
    assert len(named) > 5
    assert named - told_names() == set()


def test_the_dashboard_is_what_is_written_from_the_table() -> None:
    assert text() == DASHBOARD.read_text(encoding="utf-8"), (
        "deploy/grafana/dashboard.json is old: run python -m deploy.grafana."
    )


def test_the_dashboard_shows_every_figure_of_a_learner() -> None:
    of_run = {each.name for each in PrometheusSink().collect() if each.type != "info"}
    shown = {name.removesuffix("_total") for name in names_in(DASHBOARD.read_text())}
    assert shown == of_run


def test_a_new_figure_gets_a_panel_in_the_row_of_its_group(monkeypatch: pytest.MonkeyPatch) -> None:
    new = Metric("hands/warmth", "milliseconds", "ms", "How long the hands are warm")
    monkeypatch.setitem(METRICS, new.key, new)
    (row,) = (each for each in dashboard()["panels"] if each["title"] == "More: hands")
    (panel,) = (each for each in row["panels"] if "hands_warmth" in str(each))
    assert panel["fieldConfig"]["defaults"]["unit"] == "s"
    assert "warmth: How long the hands are warm." in panel["description"]
    targets = {each["legendFormat"]: each["expr"] for each in panel["targets"]}
    assert targets["warmth"] == f"ale_robot_hands_warmth_seconds{OF_LEARNER}"


def test_the_figures_of_one_learner_are_shown_at_a_time() -> None:
    """Two runs in one Prometheus would be drawn as one curve of each figure."""
    (choice,) = (each for each in dashboard()["templating"]["list"] if each["type"] == "query")
    assert choice["query"]["query"] == 'label_values(up{job="ale-robot-learner"}, instance)'
    assert not choice.get("multi")
    for panel in panels_of(dashboard()):
        for target in panel["targets"]:
            assert f'instance="${choice["name"]}"' in target["expr"], panel["title"]


def test_units_and_rates_of_the_dashboard_are_those_of_the_figures() -> None:
    found = {each["title"]: each for each in panels_of(dashboard())}
    for title, unit, expression in (
        ("Agent steps per second", "ops", "rate(ale_robot_run_agent_steps_total{"),
        ("Samples per insert", "short", "ale_robot_stream_samples_per_insert_ratio{"),
        ("Sight and touch", "percentunit", "ale_robot_play_valid_frame_share_ratio{"),
        ("Memory and files", "bytes", "ale_robot_run_memory_bytes{"),
        ("Red health checks", "short", "ale_robot_gates_red"),
        ("Throttled share, by actor", "percentunit", "ale_robot_actor_throttled_share_ratio"),
    ):
        assert found[title]["fieldConfig"]["defaults"]["unit"] == unit
        assert found[title]["targets"][0]["expr"].startswith(expression)


def test_each_panel_of_the_dashboard_has_a_unit_and_says_what_it_shows() -> None:
    known = {"bytes", "s", "ops", "percentunit", "short"}
    for panel in panels_of(json.loads(DASHBOARD.read_text())):
        assert panel["fieldConfig"]["defaults"]["unit"] in known, panel["title"]
        assert panel["description"].count(":") >= len(panel["targets"]) > 0, panel["title"]


def test_panels_of_the_dashboard_have_places_titles_and_numbers_of_their_own() -> None:
    every = list(flat(dashboard()["panels"]))
    titles, numbers = ({each[name] for each in every} for name in ("title", "id"))
    assert len(titles) == len(numbers) == len(every)
    for inside in (dashboard()["panels"], *(each.get("panels", []) for each in every)):
        places = {(each["gridPos"]["x"], each["gridPos"]["y"]) for each in inside}
        assert len(places) == len(inside)


def test_each_alert_fires_and_is_silent_of_a_healthy_run() -> None:
    promtool = tool("promtool")
    for what in (["check", "config", "prometheus.yml"], ["test", "rules", "alerts_test.yml"]):
        done = subprocess.run(
            [promtool, *what], cwd=PROMETHEUS, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
    alerts = re.findall(r"alert: (\w+)", (PROMETHEUS / "alerts.yml").read_text())
    tests = re.split(r"(?m)^  - name: ", (PROMETHEUS / "alerts_test.yml").read_text())
    for alert in alerts:
        assert f"alertname: {alert}}}" in tests[1]
        assert any(f"alertname: {alert}\n        exp_alerts:\n" in test for test in tests)


def test_a_real_prometheus_reads_a_learner_and_answers_every_panel(tmp_path: Path) -> None:
    promtool = tool("promtool")
    page = free_endpoint().removeprefix("tcp/")
    sink = PrometheusSink()
    known = {metric.key: 1 for metric in METRICS.values() if metric.form != "text"}
    values = {"learning/updates": 1_250, "hands/press_p99": 66.5, "replay/private_bytes": None}

    def write(values: Values) -> None:
        sink.write(
            snapshot(
                {**known, **values},
                actors=(ActorView(stats=ActorStats("a-1", "actor", steps=7), alive=True),),
                checks=(
                    HealthCheck(name="valid frames", value=0.1, passed=False, bound="", why="x"),
                ),
            )
        )

    write(values)
    with http_endpoints(page, sink.pages):
        with urllib.request.urlopen(f"http://{page}/metrics", timeout=5) as answer:
            metrics = answer.read()
        lint = subprocess.run(
            [promtool, "check", "metrics"], input=metrics, capture_output=True, check=False
        )
        assert (lint.returncode, lint.stdout + lint.stderr) == (0, b"")
        with prometheus(page, tmp_path) as told:
            (updates,) = told.ask("ale_robot_learning_updates_total")
            assert (updates["value"][1], updates["metric"]["job"]) == ("1250", "ale-robot-learner")
            assert told.ask("ale_robot_hands_press_p99_seconds")[0]["value"][1] == "0.0665"
            assert told.ask("ale_robot_replay_private_bytes") == []
            assert told.ask("ale_robot_actor_steps_total")[0]["metric"]["actor"] == "a-1"
            assert told.ask("ale_robot_gates_red")[0]["metric"]["check"] == "valid frames"
            write({})
            told.ask_every_panel()

"""Grafana's dashboard of a real run: every query has an answer, or is of what that run has not."""

import json
import re
import signal
from pathlib import Path

from benchmarks.child import free_endpoint
from deploy.grafana import DASHBOARD
from tests.deploy.prometheus import panels_of, prometheus
from tests.end_to_end.conftest import SMALL, Stage

HAS_NOT = re.compile(r"_gpu_|_(press|release)_(p50|p99|given_up)_")
"""Figures of a GPU, and of the hands that an emulator has not got."""


def test_every_query_of_the_dashboard_has_an_answer_from_a_real_run(
    stage: Stage, tmp_path: Path
) -> None:
    page = free_endpoint().removeprefix("tcp/")
    explored = ("--exploration.steps=100", "--steps=1000000")
    learner = stage.learner("--local", "--env=ale", "--http", page, *SMALL, *explored)
    learner.says("actors find it at")
    panels = panels_of(json.loads(DASHBOARD.read_text()))
    queries = {target["expr"] for panel in panels for target in panel["targets"]}
    has_not = {query for query in queries if HAS_NOT.search(query)}
    with prometheus(page, tmp_path) as told:
        told.ask_every_panel(empty=has_not)
        assert [query for query in has_not if told.ask(query)] == []
    learner.send(signal.SIGTERM)
    learner.ends()

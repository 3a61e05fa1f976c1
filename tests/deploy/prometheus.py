"""A real Prometheus, as `deploy/prometheus` sets it up, and the dashboard's queries."""

import json
import re
import shutil
import subprocess
import sys
import urllib.parse
import urllib.request
from collections.abc import Iterator, Set
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from benchmarks.child import free_endpoint
from deploy.grafana import DASHBOARD, flat
from tests.paths import ROOT
from tests.patience import wait_until

PROMETHEUS = ROOT / "deploy/prometheus"


def tool(name: str) -> str:
    """Path of a program that the test is skipped without."""
    found = shutil.which(name) or shutil.which(name, path=str(Path(sys.executable).parent))
    return found or pytest.skip(f"{name} is not installed: deploy/install_test_tools.sh brings it")


def panels_of(board: dict[str, Any]) -> list[dict[str, Any]]:
    """Panels that show something, those in closed rows too."""
    return [panel for panel in flat(board["panels"]) if panel["type"] != "row"]


class Prometheus:
    """Answers queries at ``address``."""

    def __init__(self, address: str, learner: str) -> None:
        self._address, self._learner = address, learner

    def ask(self, query: str) -> list[dict[str, Any]]:
        """Answers a query of the dashboard, in which a person has chosen the learner."""
        asked = urllib.parse.urlencode({"query": query.replace("$learner", self._learner)})
        url = f"http://{self._address}/api/v1/query?{asked}"
        with urllib.request.urlopen(url, timeout=60) as told:
            found: list[dict[str, Any]] = json.load(told)["data"]["result"]
            return found

    def has_read(self) -> bool:
        """Whether it has read a learner's page."""
        try:
            return bool(self.ask("ale_robot_gates_red"))
        except OSError:
            return False

    def ask_every_panel(self, empty: Set[str] = frozenset()) -> None:
        """Waits until every query of the dashboard has an answer with the labels of its legend.

        Args:
            empty: queries that have none.
        """
        board = json.loads(DASHBOARD.read_text())
        (choice,) = (each for each in board["templating"]["list"] if each["name"] == "learner")
        offered = re.fullmatch(r"label_values\((.*), (\w+)\)", choice["query"]["query"])
        assert offered
        assert [each["metric"][offered[2]] for each in self.ask(offered[1])] == [self._learner]
        for panel in panels_of(board):
            for target in panel["targets"]:
                query = target["expr"]
                if query in empty:
                    continue
                found = wait_until(
                    partial(self.ask, query),  # a rate needs two readings
                    f"{panel['title']} has {query}",
                )
                labels = set(re.findall(r"{{(\w+)}}", target["legendFormat"]))
                assert all(labels <= series["metric"].keys() for series in found)


@contextmanager
def prometheus(page: str, folder: Path) -> Iterator[Prometheus]:
    """A Prometheus that reads the learner's ``page`` five times a second."""
    program, own = tool("prometheus"), free_endpoint().removeprefix("tcp/")
    told = (PROMETHEUS / "prometheus.yml").read_text()
    config = folder / "prometheus.yml"
    config.write_text(told.replace("127.0.0.1:9108", page).replace("15s", "200ms"))
    shutil.copy(PROMETHEUS / "alerts.yml", folder)
    files = (f"--config.file={config}", f"--storage.tsdb.path={folder / 'data'}")
    process = subprocess.Popen(
        [program, *files, f"--web.listen-address={own}", "--log.level=error"]
    )
    try:
        found = Prometheus(own, page)
        wait_until(found.has_read, "Prometheus has read the learner's page")
        yield found
    finally:
        process.kill()
        process.wait()

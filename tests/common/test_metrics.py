"""The table of figures: complete, unique, and with the names that readers of runs know."""

import re
from dataclasses import replace
from typing import get_args

import pytest

from common.metrics import METRICS, Metric, Unit, declare
from learner.telemetry.formats import FORMS


@pytest.mark.parametrize("metric", METRICS.values(), ids=METRICS)
def test_each_figure_is_declared_in_full(metric: Metric) -> None:
    assert re.fullmatch(r"[a-z]+/[a-z0-9_]+", metric.key)
    assert metric.unit in get_args(Unit)
    assert metric.form in FORMS
    assert re.fullmatch(r"[A-Z0-9].{3,}[^.\s]", metric.meaning)
    # It is read alone, such as in a HELP line of Prometheus.
    assert not re.search(r"\b(the same|these|those two)\b", metric.meaning, re.IGNORECASE)
    assert bool(metric.label) == (metric.panel is not None)
    for template in (metric.label, metric.shown, metric.line):
        assert set(re.findall(r"\{(.+?)\}", template)) <= METRICS.keys()


def test_no_two_figures_have_one_place() -> None:
    for places in (
        [re.sub(r"\W", "_", metric.key) for metric in METRICS.values()],
        [metric.panel for metric in METRICS.values() if metric.panel],
        [metric.summary for metric in METRICS.values() if metric.summary],
        [metric.gate for metric in METRICS.values() if metric.gate],
    ):
        assert len(set(places)) == len(places)


def test_a_second_declaration_is_refused() -> None:
    known = METRICS["stream/chunks_refused"]
    before = dict(METRICS)
    for wrong in (known, replace(known, key="a/b"), replace(known, key="a/b", gate="")):
        with pytest.raises(ValueError, match="is declared already"):
            declare(wrong)
    for wrong in (Metric("no_group", "none", "text", "Any"), Metric("a/b", "none", "text", "")):
        with pytest.raises(ValueError, match="needs a meaning"):
            declare(wrong)
    assert before == METRICS


def test_curves_keep_the_names_that_they_always_had() -> None:
    assert {metric.key for metric in METRICS.values() if metric.curve} >= {
        "play/train_reward",
        "play/games",
        "learning/epsilon",
        "learning/loss",
        "learning/mean_max_q",
        "learning/held_out_std",
        "learning/updates",
        "learning/updates_per_second",
        "stream/steps_per_second",
        "stream/samples_per_insert",
        "stream/staleness_p50",
        "stream/staleness_p95",
        "stream/weights_version",
        "stream/stored",
        "stream/actors_alive",
        "stream/chunks_made",
        "stream/chunks_acked",
        "stream/chunks_retried",
        "stream/chunks_duplicate",
        "stream/chunks_refused",
        "stream/chunks_excess",
        "gates/failed",
    }


def test_columns_of_gates_keep_their_names_and_their_order() -> None:
    known = [
        "train_reward",
        "games",
        "valid_frames",
        "following_frames",
        "pixel_deviation",
        "max-Q_deviation",
        "recent_max-Q_deviation",
        "relative_TD_error",
        "keys_as_commanded",
        "press_p99_ms",
        "refused_chunks",
        "press_p50_ms",
        "release_p50_ms",
        "release_p99_ms",
    ]
    assert [metric.gate for metric in METRICS.values() if metric.gate in known] == known

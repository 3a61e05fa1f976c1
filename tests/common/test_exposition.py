"""Figures as Prometheus has them: names, units, help and values, read by its own parser."""

import math

import pytest
from prometheus_client.parser import text_string_to_metric_families

from common.exposition import exposed_name, families, metrics_page
from common.metrics import METRICS, Value


def page(values: dict[str, Value]) -> dict[str, tuple[str, str, dict[str, float]]]:
    """Type, help and samples by name."""
    text = metrics_page(lambda: families(values))().body.decode()
    return {
        each.name: (each.type, each.documentation, {s.name: s.value for s in each.samples})
        for each in text_string_to_metric_families(text)
    }


@pytest.mark.parametrize(
    ("key", "name"),
    [
        ("learning/updates", "ale_robot_learning_updates_total"),
        ("learning/loss", "ale_robot_learning_loss"),
        ("hands/press_p99", "ale_robot_hands_press_p99_seconds"),
        ("stream/stored", "ale_robot_stream_stored_steps"),
        ("stream/steps_per_second", "ale_robot_stream_steps_per_second"),
        ("replay/file_bytes", "ale_robot_replay_file_bytes"),
        ("run/epoch", "ale_robot_run_epoch"),
        ("learning/pixel_deviation", "ale_robot_learning_pixel_deviation_grey_levels"),
        ("actors/late_frames", "ale_robot_actors_late_frames_total"),
    ],
)
def test_names_follow_the_conventions(key: str, name: str) -> None:
    assert exposed_name(METRICS[key]) == name


def test_no_two_figures_have_one_name() -> None:
    assert len({exposed_name(metric) for metric in METRICS.values()}) == len(METRICS)


def test_every_figure_of_the_table_is_there_with_its_help_and_unit() -> None:
    found = page({})
    for metric in METRICS.values():
        if metric.form != "text":
            kind, help_text, _ = found[exposed_name(metric).removesuffix("_total")]
            assert kind == ("counter" if metric.counter else "gauge")
            unit = {"milliseconds": " (seconds)", "none": ""}.get(metric.unit, f" ({metric.unit})")
            assert help_text == metric.meaning + unit


def test_values_are_in_base_units_and_the_unknown_has_none() -> None:
    values: dict[str, Value] = {
        "learning/updates": 1_250,
        "learning/loss": math.nan,
        "hands/press_p50": 50.0,
        "hands/press_p99": math.inf,
        "learning/mean_max_q": None,
    }
    found = page(values)
    assert found["ale_robot_learning_updates"][2] == {"ale_robot_learning_updates_total": 1_250}
    assert math.isnan(found["ale_robot_learning_loss"][2]["ale_robot_learning_loss"])
    assert list(found["ale_robot_hands_press_p50_seconds"][2].values()) == [0.05]
    assert list(found["ale_robot_hands_press_p99_seconds"][2].values()) == [math.inf]
    assert found["ale_robot_learning_mean_max_q"][2] == {}


def test_texts_are_labels() -> None:
    text = metrics_page(lambda: families({"run/game": 'po"ng\n', "run/phase": "warm-up"}))().body
    (info,) = (e for e in text_string_to_metric_families(text.decode()) if e.name.endswith("_info"))
    assert info.samples[0].labels == {"game": 'po"ng\n', "phase": "warm-up"}

"""Charts of block characters."""

from learner.telemetry.sinks.charts import bars, columns_of


def test_chart_by_hand() -> None:
    assert bars([0.0, 0.5, 1.0], 0.0, 1.0, 1) == ["▁▅█"]  # 1, 1 + 3.5, 8 eighths
    assert bars([0.0, 1.0], 0.0, 1.0, 2) == [" █", "▁█"]
    assert bars([2.0, 2.0], 2.0, 2.0, 1) == ["▄▄"]
    assert columns_of([1.0, 2.0, 3.0, 4.0], 2) == [1.5, 3.5]
    assert columns_of([1.0, 2.0], 5) == [1.0, 1.0, 2.0, 2.0]
    assert columns_of([], 5) == []

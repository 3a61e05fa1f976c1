"""Event files of TensorBoard, which are read in the order of their names."""

import pytest
from tensorboard.summary.writer import event_file_writer


@pytest.fixture(autouse=True)
def numbered_from_0(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two files that one process begins in one second are told apart by a number, which is compared
    as text: 9 comes after 10."""
    counter = event_file_writer.AtomicCounter(0)  # type: ignore[no-untyped-call]
    monkeypatch.setattr(event_file_writer, "_global_uid", counter)

"""Max-Q over states that were held out, and over those of late, by a network worked out by hand."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import save

from common.errors import InputError
from common.settings.presets import PRESETS
from learner.telemetry.held_out import LEAST_RECENT, RECENT, RECENT_STEPS, HeldOut
from tests.full_disk import files_of_at_most

CONFIG = PRESETS["fast"]


class Memory:
    """A replay whose states are their numbers: the newest 32 of 100, or all of them."""

    def __init__(self) -> None:
        self.asked: list[tuple[int, int | None]] = []
        self.recent = np.arange(68, 100)

    def held_out(self, count: int, newest: int | None = None) -> tuple[Any, Any]:
        self.asked.append((count, newest))
        numbers = np.arange(100) if newest is None else self.recent
        frames = np.full((min(count, len(numbers)), 4, 84, 84), 0, np.uint8)
        frames[:] = numbers[: len(frames), None, None, None]
        return frames, np.zeros((len(frames), 0), np.float32)


FIRST_PIXEL: Any = SimpleNamespace(max_q=lambda frames, _: frames[:, 0, 0, 0].float())
"""An algorithm whose max-Q is a state's number."""


def held_out(path: Path, memory: Any, count: int = 5, algorithm: Any = FIRST_PIXEL) -> HeldOut:
    protocol = replace(CONFIG.protocol, held_out_states=count)
    return HeldOut(path, replace(CONFIG, protocol=protocol), algorithm, memory)


def test_both_sets_are_measured_apart(tmp_path: Path) -> None:
    memory: Any = Memory()
    held = held_out(tmp_path / "held_out", memory)
    held.draw()
    held.measure()
    assert memory.asked == [(5, None), (RECENT, RECENT_STEPS)]
    assert held.values() == {
        "learning/mean_max_q": 2.0,  # of 0, 1, 2, 3 and 4
        "learning/held_out_std": pytest.approx(2**0.5),
        "learning/recent_max_q_std": pytest.approx(((32**2 - 1) / 12) ** 0.5),  # of 32 in a row
    }
    assert held.mean == 2.0
    assert held.histogram is not None
    assert (held.histogram.edges[0], held.histogram.edges[-1]) == (0.0, 4.0)
    assert [count for count in held.histogram.counts if count] == [1, 1, 1, 1, 1]


def test_a_frozen_camera_leaves_the_recent_states_without_deviation(tmp_path: Path) -> None:
    memory: Any = Memory()
    held = held_out(tmp_path / "held_out", memory, 50)
    held.draw()
    memory.recent = np.full(32, 7)
    held.measure()
    deviation = held.values()["learning/held_out_std"]
    assert isinstance(deviation, float)
    assert deviation > 10
    assert held.values()["learning/recent_max_q_std"] == 0.0


@pytest.mark.parametrize("count", [0, LEAST_RECENT - 1])
def test_too_few_recent_states_tell_nothing(tmp_path: Path, count: int) -> None:
    memory: Any = Memory()
    memory.recent = np.arange(count)
    held = held_out(tmp_path / "held_out", memory)
    held.measure()
    assert set(held.values().values()) == {None}


def test_too_few_recent_states_leave_no_older_value(tmp_path: Path) -> None:
    memory: Any = Memory()
    held = held_out(tmp_path / "held_out", memory)
    held.measure()
    assert held.values()["learning/recent_max_q_std"]
    memory.recent = np.arange(LEAST_RECENT - 1)
    held.measure()
    assert held.values()["learning/recent_max_q_std"] is None


def test_without_a_state_to_hold_out_none_is_kept(tmp_path: Path) -> None:
    held_out(tmp_path / "held_out", Memory(), 0).draw()
    assert not list(tmp_path.iterdir())


def test_the_set_is_drawn_once_as_soon_as_there_is_a_state(tmp_path: Path) -> None:
    memory: Any = Memory()
    seen: list[int] = []
    memory.held_out = lambda count, newest=None: (
        np.full((len(seen), 4, 84, 84), sum(seen), np.uint8),
        np.zeros((len(seen), 0), np.float32),
    )
    held = held_out(tmp_path / "held_out", memory)
    for number in (0, 7, 8):  # no state was wholly seen in the warm-up
        seen += [number] if number else []
        held.draw()
        held.measure()
        assert held.mean == (7.0 if number else None)


def test_a_full_disk_delays_the_file_of_the_states(tmp_path: Path) -> None:
    path = tmp_path / "held_out"
    held = held_out(path, Memory())
    with files_of_at_most(4096), pytest.raises(OSError, match="File too large"):
        held.draw()
    held.draw()  # as `insist` does
    assert path.is_file()


def test_the_held_out_states_are_kept_for_who_resumes(tmp_path: Path) -> None:
    path = tmp_path / "held_out"
    memory: Any = Memory()
    held_out(path, memory, 3).draw()
    again = held_out(path, memory, 3)
    again.measure()
    assert again.values()["learning/mean_max_q"] == 1.0
    assert again.values()["learning/held_out_std"] == pytest.approx((2 / 3) ** 0.5)
    path.write_bytes(b"no tensors")
    with pytest.raises(InputError, match="is damaged"):
        held_out(path, memory, 3)


@pytest.mark.parametrize(
    "tensors",
    [
        {"frames": torch.zeros(2, 3, 84, 84, dtype=torch.uint8), "vectors": torch.zeros(2, 0)},
        {"frames": torch.zeros(2, 4, 84, 84), "vectors": torch.zeros(2, 0)},
        {"frames": torch.zeros(2, 4, 84, 84, dtype=torch.uint8), "vectors": torch.zeros(2, 1)},
        {"frames": torch.zeros(0, 4, 84, 84, dtype=torch.uint8), "vectors": torch.zeros(0, 0)},
        {"frames": torch.tensor(1, dtype=torch.uint8), "vectors": torch.zeros(1, 0)},
        {"frames": torch.zeros(2, 4, 84, 84, dtype=torch.uint8)},
    ],
)
def test_states_of_another_run_are_refused(tmp_path: Path, tensors: Any) -> None:
    path = tmp_path / "held_out"
    path.write_bytes(save(tensors))
    with pytest.raises(InputError, match="held_out is damaged"):
        held_out(path, Memory())


@pytest.mark.parametrize(
    ("least", "most"),
    [
        (1.0, float(np.nextafter(np.float32(1), np.float32(2)))),  # float32 has none between them
        (0.0, 1e-45),
        (5.0, 5.0),
        (-1e6, -1e6),
        (3e38, 3e38),
        (-3e38, 3e38),
    ],
)
def test_a_network_that_has_collapsed_is_measured_too(
    tmp_path: Path, least: float, most: float
) -> None:
    """Its values are all one, but for the last bit, by which batches of other sizes differ."""
    values = SimpleNamespace(
        max_q=lambda frames, _: torch.tensor([most, *[least] * (len(frames) - 1)])
    )
    held = held_out(tmp_path / "held_out", Memory(), algorithm=values)
    held.draw()
    held.measure()
    assert held.histogram is not None
    assert sum(held.histogram.counts) == 5
    assert max(held.histogram.counts) == (5 if least == most else 4)
    edges = held.histogram.edges
    assert all(low < high for low, high in pairwise(edges))
    assert edges[0] <= least <= most <= edges[-1]


def test_values_are_of_states_as_they_are(tmp_path: Path) -> None:
    """No gradient, and no change of what the replay gave."""
    seen: list[torch.Tensor] = []

    def max_q(frames: torch.Tensor, _: torch.Tensor) -> torch.Tensor:
        seen.append(frames)
        return frames[:, 0, 0, 0].float()

    held = held_out(tmp_path / "held_out", Memory(), 2, SimpleNamespace(max_q=max_q))
    held.draw()
    held.measure()
    assert [tuple(each.shape) for each in seen] == [(2, 4, 84, 84), (32, 4, 84, 84)]
    assert all(each.dtype == torch.uint8 for each in seen)

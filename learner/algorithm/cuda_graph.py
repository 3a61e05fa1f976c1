"""A gradient step as one CUDA graph: recorded once, then launched as a whole.

An update of this small network is more than a hundred kernels of a few microseconds each; launching
them one by one from Python takes longer than they do
(https://docs.pytorch.org/docs/stable/notes/cuda.html#cuda-graphs).
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from learner.algorithm.interface import Prepared, Update

Step = Callable[[Prepared], Update]
Launch = Callable[[], object]

_EAGER = 3
"""Number of calls before the recording, in which libraries choose kernels and allocate memory."""


def record_graph(kernels: Callable[[], None]) -> Launch:
    """Records what ``kernels`` launches, without computing it; returns a function that launches the
    recording."""
    graph = torch.cuda.CUDAGraph()
    # Only this thread's calls are recorded: another one prepares the next minibatch meanwhile.
    with torch.cuda.graph(graph, capture_error_mode="thread_local"):
        kernels()
    return graph.replay


def run_aside(kernels: Callable[[], None]) -> None:
    """Runs ``kernels`` on a stream of its own, as CUDA requires before a recording."""
    stream = torch.cuda.Stream()  # type: ignore[no-untyped-call]
    here = torch.cuda.current_stream()
    stream.wait_stream(here)
    with torch.cuda.stream(stream):
        kernels()
    here.wait_stream(stream)


@dataclass
class RecordedStep:
    """Does what ``step`` does; from the fourth call on, it launches a recording of its kernels.

    All calls must have tensors of the same shapes. ``step`` may depend only on tensors that stay at
    their addresses: a Python number would keep the value that it had at the recording.
    """

    step: Step
    record: Callable[[Callable[[], None]], Launch] = record_graph
    aside: Callable[[Callable[[], None]], None] = run_aside

    def __post_init__(self) -> None:
        self._calls = 0
        self._launch: Launch | None = None
        self._input: Prepared
        """Tensors that the recording reads."""
        self._output: Update
        """Tensors that the recording writes."""

    def __call__(self, prepared: Prepared) -> Update:
        self._calls += 1
        if self._calls <= _EAGER:
            self._input = prepared
            self.aside(self._run)
            return self._output
        if self._launch is None:
            self._input = copy.deepcopy(prepared)
            self._launch = self.record(self._run)
        else:
            torch._foreach_copy_(_tensors(self._input), _tensors(prepared))
        self._launch()
        # Copies, because the next call overwrites them, and callers may look at an update later.
        loss, priorities, td_errors, targets, metrics = self._output
        copies = {name: value.clone() for name, value in metrics.items()}
        return Update(loss.clone(), priorities.clone(), td_errors.clone(), targets.clone(), copies)

    def _run(self) -> None:
        self._output = self.step(self._input)


def _tensors(prepared: Prepared) -> list[Tensor]:
    *tensors, drawn = prepared.batch
    pixels = [prepared.pixels_tm1, prepared.pixels_t]
    return [*tensors, *drawn.values(), *pixels, *prepared.target_outputs]

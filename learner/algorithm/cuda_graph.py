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
"""Calls before the recording, in which libraries choose their kernels and take their memory."""


def record_graph(kernels: Callable[[], None]) -> Launch:
    """Returns what launches all that ``kernels`` launches; recording it computes nothing."""
    graph = torch.cuda.CUDAGraph()
    # Another thread prepares the next minibatch meanwhile: only this one's calls are recorded.
    with torch.cuda.graph(graph, capture_error_mode="thread_local"):
        kernels()
    return graph.replay


def run_aside(kernels: Callable[[], None]) -> None:
    """Run ``kernels`` on another stream than the default one, as must be before a recording."""
    stream = torch.cuda.Stream()  # type: ignore[no-untyped-call]
    here = torch.cuda.current_stream()
    stream.wait_stream(here)
    with torch.cuda.stream(stream):
        kernels()
    here.wait_stream(stream)


@dataclass
class RecordedStep:
    """Does what ``step`` does, from the fourth call on by a recording of its kernels.

    All calls must have tensors of the same shapes. ``step`` may depend on nothing but tensors that
    stay in their places: a number of Python's would stay as it was when recorded.
    """

    step: Step
    record: Callable[[Callable[[], None]], Launch] = record_graph
    aside: Callable[[Callable[[], None]], None] = run_aside

    def __post_init__(self) -> None:
        self._calls = 0
        self._launch: Launch | None = None
        self._input: Prepared
        """Where the recording reads."""
        self._output: Update
        """Where it writes."""

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
        # The next call overwrites them, and who gets an update may look at it later.
        loss, priorities, metrics = self._output
        copies = {name: value.clone() for name, value in metrics.items()}
        return Update(loss.clone(), priorities.clone(), copies)

    def _run(self) -> None:
        self._output = self.step(self._input)


def _tensors(prepared: Prepared) -> list[Tensor]:
    pixels = [prepared.pixels_tm1, prepared.pixels_t]
    return [*prepared.batch, *pixels, *prepared.target_outputs]

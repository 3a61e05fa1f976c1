"""A recorded gradient step does what the step does, also where it reads what was changed."""

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import pytest
import torch
from torch import Tensor, UntypedStorage
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from common.network import QNetwork
from common.settings.config import LearningConfig
from learner.algorithm import value_based
from learner.algorithm.cuda_graph import RecordedStep
from learner.algorithm.double_dqn import double_dqn
from learner.algorithm.interface import DeviceBatch, Prepared, Update
from learner.algorithm.qr_dqn import qr_dqn
from learner.algorithm.value_based import ValueBased
from learner.device import Device
from tests.learner.small_batches import learn, random_batch

CPU = torch.device("cpu")
CUDA = pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no CUDA device here")
CONFIG = LearningConfig(
    learning_rate=1e-3,
    annealing_steps=40 * 16,
    final_learning_rate=1e-4,
    weights_average=0.9,
    train_period=16,
    target_update_period=7,
)


def _called(step: Callable[[Prepared], Update]) -> RecordedStep:
    """A recording whose launch calls the step."""
    return RecordedStep(step, record=lambda kernels: kernels, aside=lambda kernels: kernels())


def _replayed(step: Callable[[Prepared], Update]) -> RecordedStep:
    """A recording of PyTorch's operations, whose launch runs no Python, as that of a CUDA graph."""
    return RecordedStep(step, record=_record_operations, aside=lambda kernels: kernels())


def _record_operations(kernels: Callable[[], None]) -> Callable[[], None]:
    """`learner.algorithm.cuda_graph.record_graph` for a CPU."""
    recorded = _Operations()
    with recorded:
        kernels()
    for storage, before in recorded.written.values():
        storage.copy_(before)  # a recording does not compute
    return recorded.launch


class _Operations(TorchDispatchMode):  # type: ignore[no-untyped-call]
    """Remembers each operation with its numbers, the tensors that it reads, and those it writes."""

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.written: dict[int, tuple[UntypedStorage, UntypedStorage]] = {}
        """What was written in place, and its content before that, by address."""
        self._operations: list[tuple[Any, Any, Any, list[Tensor]]] = []

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        named = zip(func._schema.arguments, args, strict=False)
        given = [*named, *((each, kwargs.get(each.name)) for each in func._schema.arguments)]
        for argument, value in given:
            if argument.alias_info is not None and argument.alias_info.is_write:
                for tensor in _tensors_of(value):
                    storage = tensor.untyped_storage()
                    before = storage.clone()  # type: ignore[no-untyped-call]
                    self.written.setdefault(storage.data_ptr(), (storage, before))
        made = func(*args, **kwargs)
        self._operations.append((func, args, kwargs, _tensors_of(made)))
        return made

    @torch.no_grad()
    def launch(self) -> None:
        for func, args, kwargs, written in self._operations:
            read = {tensor.untyped_storage().data_ptr() for tensor in _tensors_of((args, kwargs))}
            again = _tensors_of(func(*args, **kwargs))
            for tensor, value in zip(written, again, strict=True):
                if tensor.untyped_storage().data_ptr() not in read:  # neither a view nor in place
                    tensor.copy_(value)


def _tensors_of(values: Any) -> list[Tensor]:
    return [leaf for leaf in tree_leaves(values) if isinstance(leaf, Tensor)]


def _tensors(prepared: Prepared) -> list[Tensor]:
    """All that a step may read."""
    *tensors, drawn = prepared.batch
    pixels = [prepared.pixels_tm1, prepared.pixels_t]
    return [*tensors, *drawn.values(), *pixels, *prepared.target_outputs]


def _learner(device: Device, config: LearningConfig = CONFIG) -> ValueBased:
    torch.manual_seed(0)
    if config.algorithm == "qr_dqn":
        return qr_dqn(QNetwork(6, atoms=config.quantiles), config, device)
    return double_dqn(QNetwork(6), config, device)


def _with_rate_on_device(algorithm: ValueBased) -> ValueBased:
    """As on CUDA, the optimizer reads its rate from a tensor."""
    for group in algorithm._optimizer._optimizer.param_groups:
        group["lr"] = torch.tensor(group["lr"])
    return algorithm


def _on(device: torch.device, batch: DeviceBatch) -> DeviceBatch:
    fields = batch._asdict()
    del fields["drawn"]
    return batch._replace(**{name: tensor.to(device) for name, tensor in fields.items()})


def _learned(algorithm: ValueBased, device: torch.device, updates: int = 20) -> list[float]:
    losses = []
    for seed in range(updates):
        batch = random_batch(seed=seed)
        if seed == 11:  # a recording must skip it too
            batch.r_t[0] = torch.nan
        losses.append(learn(algorithm, _on(device, batch)).loss)
    return [float(loss) for loss in losses]  # after all of them: none was overwritten


def _state(algorithm: ValueBased) -> dict[str, Tensor]:
    return {name: value.cpu() for name, value in algorithm.state().items()}


@pytest.mark.parametrize("algorithm", ["dqn", "qr_dqn"])
def test_a_recorded_step_has_the_same_updates(
    algorithm: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A bound that each gradient exceeds: on a CPU, whether it does so is asked in Python.
    config = replace(CONFIG, algorithm=algorithm, gradient_norm=1e-3)
    plain = _with_rate_on_device(_learner(Device(CPU, bfloat16=False), config))
    monkeypatch.setattr(value_based, "RecordedStep", _replayed)
    recorded = _with_rate_on_device(_learner(Device(CPU, bfloat16=False, graphs=True), config))

    expected, losses = _learned(plain, CPU), _learned(recorded, CPU)

    torch.testing.assert_close(losses, expected, rtol=0, atol=0, equal_nan=True)
    for name, value in _state(plain).items():
        assert torch.equal(_state(recorded)[name], value), name


def test_a_recording_reads_where_each_minibatch_is_copied_to() -> None:
    """What the step is called with stays in one place from the fourth call on."""
    places: list[list[int]] = []
    seen: list[list[Tensor]] = []

    def step(prepared: Prepared) -> Update:
        tensors = _tensors(prepared)
        places.append([each.data_ptr() for each in tensors])
        seen.append([each.clone() for each in tensors])
        return Update(torch.zeros(()), *torch.zeros(3, 8))

    recorded = _called(step)
    torch.manual_seed(0)
    *names, _ = DeviceBatch._fields  # but for `drawn`
    given = []
    for n in range(6):
        fields = dict(zip(names, torch.rand(8, 8, 2), strict=True))
        batch = DeviceBatch(**fields, drawn={"scores": torch.rand(8)})
        pixels_tm1, pixels_t = torch.rand(2, 8)
        outputs = (torch.rand(8), torch.ones(8) * n)
        given.append(Prepared(batch, pixels_tm1, pixels_t, outputs))
    for each in given:
        recorded(each)

    first, *others = places[3:]
    assert places[:3] == [[tensor.data_ptr() for tensor in _tensors(each)] for each in given[:3]]
    assert all(other == first for other in others)
    for found, each in zip(seen, given, strict=True):
        assert all(map(torch.equal, found, _tensors(each)))


def test_what_a_recording_returned_outlasts_the_next_launch() -> None:
    """A recording writes into the same tensors at each launch."""
    algorithm = _learner(Device(CPU, bfloat16=False))
    most = {"most": torch.zeros(())}
    written = Update(torch.zeros(()), torch.zeros(8), torch.zeros(8), torch.zeros(8), most)

    def step(prepared: Prepared) -> Update:
        written.loss.copy_(prepared.batch.r_t.sum())
        written.priorities.copy_(prepared.batch.r_t.abs())
        written.td_errors.copy_(prepared.batch.r_t)
        written.targets.copy_(prepared.batch.r_t + 1)
        written.metrics["most"].copy_(prepared.batch.r_t.max())
        return written

    recorded = _called(step)
    batches = [random_batch(seed=seed) for seed in range(6)]
    updates = [recorded(algorithm.prepare(batch)) for batch in batches]
    for batch, update in zip(batches[3:], updates[3:], strict=True):
        assert torch.equal(update.loss, batch.r_t.sum())
        assert torch.equal(update.priorities, batch.r_t.abs())
        assert torch.equal(update.td_errors, batch.r_t)
        assert torch.equal(update.targets, batch.r_t + 1)
        assert torch.equal(update.metrics["most"], batch.r_t.max())


def test_a_restored_state_is_recorded_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[RecordedStep] = []

    def recording(step: Callable[[Prepared], Update]) -> RecordedStep:
        made.append(_replayed(step))
        return made[-1]

    monkeypatch.setattr(value_based, "RecordedStep", recording)
    config = replace(CONFIG, gradient_norm=1e-3)
    first = _with_rate_on_device(_learner(Device(CPU, bfloat16=False, graphs=True), config))
    _learned(first, CPU)
    before = copy.deepcopy(first.state())
    expected = _learned(first, CPU)
    first.load_state(before)
    first.continue_from(20)
    assert _learned(first, CPU) == pytest.approx(expected, nan_ok=True)
    assert len(made) == 2  # the former one knows where the optimizer's former tensors were


def test_a_number_of_python_keeps_its_value_in_a_recording() -> None:
    """So the tests above would see a step that reads one."""
    calls = 0

    def step(prepared: Prepared) -> Update:
        nonlocal calls
        calls += 1
        return Update(prepared.batch.r_t.sum() * calls, *torch.zeros(3, 8))

    recorded = _replayed(step)
    algorithm = _learner(Device(CPU, bfloat16=False))
    batches = [random_batch(seed=seed) for seed in range(6)]
    losses = [float(recorded(algorithm.prepare(batch)).loss) for batch in batches]
    sums = [float(batch.r_t.sum()) for batch in batches]
    assert losses == pytest.approx([sums[0], 2 * sums[1], 3 * sums[2], *(4 * s for s in sums[3:])])


@CUDA
@pytest.mark.parametrize("algorithm", ["dqn", "qr_dqn"])
@pytest.mark.parametrize("optimizer", ["adam", "rmsprop"])
@pytest.mark.parametrize("bfloat16", [False, True])
def test_a_graph_has_the_same_updates(
    bfloat16: bool, optimizer: Literal["adam", "rmsprop"], algorithm: str
) -> None:
    device = torch.device("cuda")
    config = replace(CONFIG, optimizer=optimizer, algorithm=algorithm)
    plain = _learner(Device(device, bfloat16), config)
    graph = _learner(Device(device, bfloat16, graphs=True), config)

    expected, losses = _learned(plain, device), _learned(graph, device)

    torch.testing.assert_close(losses, expected, rtol=1e-2, atol=1e-3, equal_nan=True)
    first = _learner(Device(device, bfloat16), config).state()
    for name, value in plain.state().items():
        if name.startswith("online."):
            moved = (value - first[name]).norm()
            assert (graph.state()[name] - value).norm() < 0.1 * moved, name


@CUDA
def test_updates_on_cuda_are_those_of_the_processor() -> None:
    plain, cuda = _learner(Device(CPU, False)), _learner(Device(torch.device("cuda"), False))
    expected, losses = _learned(plain, CPU, 10), _learned(cuda, torch.device("cuda"), 10)
    torch.testing.assert_close(losses, expected, rtol=1e-2, atol=1e-3)

"""`python -m benchmarks.learner_updates`: how long an update takes, on what, and how exact it is.

* Time by threads and precision; the settings take turns, a few updates each.
* Time by kind of work, from PyTorch's profiler; on the CPU only.
* Time by layer, each alone, beside the best rate of PyTorch's products; on the CPU only.
* Time by part of the native kernel, each alone; where it can be compiled.
* bfloat16, and the native kernel, against float32 by PyTorch: learners learn from the same
  minibatches, whose frames come from random play in the emulator.
"""

import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any

import numpy as np
import torch
from annotated_types import Ge
from torch.profiler import ProfilerActivity, profile

from benchmarks.child import scratch
from benchmarks.layers import layers_of, time_layers, time_native
from benchmarks.pace import in_turns
from benchmarks.peer_update import DOUBLE_DQN, noise_batch
from benchmarks.random_play import random_play
from benchmarks.replay import draw
from benchmarks.report import BenchmarkOptions, Report, Table, main, with_time_left
from common.checked import FromOne
from common.native.kernel import instruction_sets
from common.native.library import multiplies_bfloat16
from common.network import build_network
from common.process.allocator import keep_large_blocks
from common.process.cores import usable_cores
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from learner.algorithm.interface import Algorithm, DeviceBatch, build_algorithm
from learner.device import Device, DeviceChoice, choose_device
from learner.prefetch import to_device

_ACTIONS = 6
_CPU = torch.device("cpu")
_RANDOM_STEPS = 4_000
_PROFILED = 40
_KINDS: dict[str, tuple[str, ...]] = {
    "convolutions, forward": ("aten::mkldnn_convolution", "aten::cudnn_convolution"),
    "convolutions, backward": ("aten::convolution_backward", "aten::mkldnn_convolution_backward"),
    "dense layers": ("aten::addmm", "aten::mm"),
    "optimizer": ("aten::_fused_adam_",),
    "copies, and pixels and weights to the other precision": (
        "aten::copy_",
        "aten::_foreach_copy_",
    ),
}
"""Operators by kind of work; all others are the rest."""


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Time updates of Double DQN, or of the fast preset's own algorithm and layers."""

    device: DeviceChoice = "cpu"
    """Hardware; 'auto' takes CUDA if available."""
    batch_size: FromOne = 32
    """Transitions per update."""
    rounds: FromOne = 40
    """Number of turns of each setting."""
    turn: FromOne = 5
    """Updates per turn."""
    compared: Annotated[int, Ge(0)] = 1_000
    """Number of updates for comparing the losses of all kinds of arithmetic; 0 for none."""
    seeds: FromOne = 8
    """Number of times that they are compared, each with first weights and minibatches of its own.
    Rounding alone moves the loss of one seed by a percent or two, in either direction."""
    preset: bool = False
    """The fast preset's QR-DQN of frame differences, with layer normalisation, instead of a Double
    DQN of plain frames, which other libraries have too."""

    @property
    def config(self) -> RunConfig:
        return PRESETS["fast"] if self.preset else DOUBLE_DQN


def algorithm_of(config: RunConfig, device: Device) -> Algorithm:
    """Returns the run's algorithm with its initial weights."""
    return build_algorithm(config, build_network(config, _ACTIONS), device)


def precisions_of(chosen: Device) -> dict[str, Device]:
    """Returns float32 and bfloat16 by PyTorch, and the native kernel by all that is here."""
    devices = {
        "float32": Device(chosen.torch, bfloat16=False),
        "bfloat16": Device(chosen.torch, bfloat16=True),
    }
    for each in instruction_sets() if chosen.torch.type == "cpu" else ():
        devices[f"native, {each}"] = Device(chosen.torch, multiplies_bfloat16(each), native=each)
    return devices


def time_settings(options: Options, chosen: Device) -> list[dict[str, Any]]:
    """Returns a row for each number of threads and precision; on CUDA, with and without a graph."""
    batch, cuda = noise_batch(options.batch_size, chosen.torch), chosen.torch.type == "cuda"
    threads = [1] if cuda else sorted({1, usable_cores()})
    algorithms = {
        (name, graphs): algorithm_of(options.config, replace(device, graphs=graphs))
        for name, device in precisions_of(chosen).items()
        for graphs in ((False, True) if cuda else (False,))
    }

    def turn(count: int, kind: tuple[str, bool]) -> list[float]:
        """Returns the seconds of each update."""
        torch.set_num_threads(count)
        algorithm = algorithms[kind]
        seconds = []
        for _ in range(options.turn):
            began = time.perf_counter()
            algorithm.update(algorithm.prepare(batch))
            if cuda:
                torch.cuda.synchronize()
            seconds.append(time.perf_counter() - began)
        return seconds

    settings = itertools.product(threads, algorithms)
    turns = in_turns({setting: partial(turn, *setting) for setting in settings}, options.rounds)
    seconds = {setting: list(itertools.chain(*each)) for setting, each in turns.items()}
    plain = float(np.median(seconds[1, ("float32", False)]))
    return [
        {
            "precision": name,
            "threads": count,
            **({"CUDA graph": "yes" if graphs else "no"} if cuda else {}),
            "p50 ms": float(np.median(times)) * 1e3,
            "p95 ms": float(np.percentile(times, 95)) * 1e3,
            "times float32 on one thread": plain / float(np.median(times)),
        }
        for (count, (name, graphs)), times in seconds.items()
    ]


def time_kinds(options: Options, *, bfloat16: bool) -> list[dict[str, Any]]:
    """Returns a row for each kind of work in an update on one thread, and for the rest."""
    torch.set_num_threads(1)
    batch = noise_batch(options.batch_size, _CPU)
    algorithm = algorithm_of(options.config, Device(_CPU, bfloat16))
    for _ in range(options.turn):
        algorithm.update(algorithm.prepare(batch))
    with profile(activities=[ProfilerActivity.CPU]) as profiled:
        for _ in range(_PROFILED):
            algorithm.update(algorithm.prepare(batch))
    spent = {each.key: each.self_cpu_time_total for each in profiled.key_averages()}
    kinds = {kind: sum(spent.get(name, 0.0) for name in names) for kind, names in _KINDS.items()}
    kinds["the rest"] = sum(spent.values()) - sum(kinds.values())
    return [
        {"work": kind, "ms": each / _PROFILED / 1e3, "share": each / sum(spent.values())}
        for kind, each in kinds.items()
    ]


def losses(algorithm: Algorithm, batches: Sequence[DeviceBatch], updates: int) -> float:
    """Returns the mean loss over ``updates`` that take ``batches`` in turn."""
    total = 0.0
    for update in range(updates):
        prepared = algorithm.prepare(batches[update % len(batches)])
        total += float(algorithm.update(prepared).loss)
    return total / updates


def compare_precisions(
    config: RunConfig, updates: int, seeds: int, chosen: Device
) -> list[dict[str, Any]]:
    """Returns a row for each precision: its loss, and how far that is from float32's in the mean
    over the seeds, with the standard error of that mean."""
    torch.set_num_threads(1)
    often = replace(config, learning=replace(config.learning, target_update_period=100))
    devices = precisions_of(chosen)
    found = np.empty((seeds, len(devices)))
    for row in with_time_left(range(seeds), lambda row: f"losses of seed {row + 1}"):
        seeded = replace(often, seed=row + 1)
        with scratch() as folder:
            memory = random_play(seeded, _RANDOM_STEPS, folder / "replay")
            batches = [to_device(draw(memory), chosen.torch) for _ in range(min(updates, 500))]
            memory.close()
        found[row] = [
            losses(algorithm_of(seeded, device), batches, updates) for device in devices.values()
        ]
    away = found / found[:, :1] - 1  # float32 is the first
    errors = away.std(axis=0, ddof=min(1, seeds - 1)) / seeds**0.5
    return [
        {
            "precision": name,
            "updates": updates,
            "seeds": seeds,
            "mean loss": loss,
            "away from float32": f"{mean:+.2%}" + (f" ± {error:.2%}" if seeds > 1 else ""),
        }
        for name, loss, mean, error in zip(
            devices, found.mean(axis=0), away.mean(axis=0), errors, strict=True
        )
    ]


def measure(options: Options) -> Report:
    keep_large_blocks()  # as a learner does
    chosen = choose_device(options.device, "auto")
    updates = options.rounds * options.turn
    kind = "The fast preset's" if options.preset else "Double DQN"
    title = f"{kind} update, batch {options.batch_size}, 84×84×4, {updates} updates each"
    tables = {"rows": Table(title, time_settings(options, chosen))}
    if chosen.torch.type == "cpu":
        precision = chosen.precision
        kinds = f"The same in {precision} on one thread, by kind of work"
        tables["kinds"] = Table(kinds, time_kinds(options, bfloat16=chosen.bfloat16))
        network = build_network(options.config, _ACTIONS)
        alone = list(layers_of(network, options.batch_size, getattr(torch, precision)))
        tables["layers"] = Table(
            f"Multiplications of its layers, each alone, in {precision} on one thread",
            time_layers(alone, updates),
        )
    if chosen.native:
        tables["native"] = Table(
            f"Parts of the native kernel in {chosen.precision}, each alone, on one thread",
            time_native(
                build_network(options.config, _ACTIONS), chosen.native, options.batch_size, updates
            ),
        )
    if options.compared:
        precisions = "Against float32 by PyTorch, the same minibatches of real frames"
        tables["precisions"] = Table(
            precisions, compare_precisions(options.config, options.compared, options.seeds, chosen)
        )
    rows = {name: table.rows for name, table in tables.items()}
    return Report(list(tables.values()), {"title": title, **rows})


if __name__ == "__main__":
    main("learner_updates", Options, measure)

"""`Storm`: strikes a run with one fault after the other, drawn by a seed."""

import os
import random
import time
from typing import Any

from benchmarks.chaos.cluster import HUB, LEARNER, Cluster
from benchmarks.chaos.faults import FAULTS, PATIENCE
from common.errors import InputError
from common.process.footprint import footprint

_SHORTEST, _LONGEST = 0.2, 3.0
"""Seconds of work between faults."""


class Storm:
    """Strikes with each kind of fault once, then with each once again, and so on.

    Args:
        seed: decides what breaks, when and for how long.
        longest: maximum duration of a fault, in seconds.
    """

    def __init__(self, cluster: Cluster, seed: int, longest: float) -> None:
        self.struck: list[dict[str, Any]] = []
        """A row for each fault: name, target, duration, what it ended, and the recovery time."""
        found = {name: fault.missing(cluster) for name, fault in FAULTS.items()}
        self.missing = {name: why for name, why in found.items() if why is not None}
        """Faults that cannot strike on this machine, each with the reason."""
        self._cluster = cluster
        self._draw = random.Random(seed)
        self._longest = longest
        self._deck: list[str] = []

    def strike(self) -> None:
        """Strikes with one fault, and waits until everything works again.

        A fault during which the run reaches its goal does not count.

        Raises:
            InputError: the run does not recover.
        """
        draw, cluster = self._draw, self._cluster
        time.sleep(draw.uniform(_SHORTEST, min(_LONGEST, self._longest)))
        if not self._deck:
            self._deck = [name for name in FAULTS if name not in self.missing]
            draw.shuffle(self._deck)
        name = self._deck.pop()
        fault, before = FAULTS[name], len(cluster.ended)
        target = draw.choice(fault.targets(cluster))
        seconds = min(draw.uniform(*fault.seconds), self._longest)
        end = fault.strike(cluster, target, draw)
        if end is not None:
            time.sleep(seconds)
            end()
        recovery = cluster.recovery(PATIENCE, struck=target)
        if cluster.finished:
            return
        if recovery is None:
            raise InputError(
                f"the run did not recover in {PATIENCE:.0f} s from: {name}, {target}, "
                f"{seconds:.1f} s{''.join(f'; {each}' for each in cluster.ended)}."
            )
        pids = {each: cluster.processes[each].pid for each in (HUB, LEARNER)}
        self.struck.append(
            {
                **{"fault": name, "target": target, "seconds": seconds, "recovery": recovery},
                "ended": cluster.ended[before:],
                "private_mib": {each: footprint(pid).private / 2**20 for each, pid in pids.items()},
                "open_files": {
                    each: len(os.listdir(f"/proc/{pid}/fd")) for each, pid in pids.items()
                },
            }
        )
        told = f"{name}, {target}: everything works again after {recovery:.1f} s"
        print(f"{len(self.struck):4} {told}", flush=True)

    @property
    def unforeseen(self) -> list[str]:
        """Processes that ended although they should not have."""
        known = [
            each for row in self.struck if FAULTS[row["fault"]].may_end for each in row["ended"]
        ]
        return [each for each in self._cluster.ended if each not in known]

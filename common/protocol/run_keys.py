"""`RunKeys`: the key expressions by which the processes of a run speak to each other."""

import re
from dataclasses import dataclass

from common.checked import NAME
from common.errors import InputError

NAMESPACE = "ale-robot"
DEMONSTRATIONS = "demonstrations"
"""Name of the actor in whose place a learner sends recorded games."""


def check_name(kind: str, name: str) -> str:
    """``name`` if it can be part of a key expression and of a path. Raises InputError if it cannot;
    ``kind`` says what was being named."""
    if not re.fullmatch(NAME, name):
        raise InputError(
            f"{kind} {name!r} cannot be used: up to 64 letters, digits, '.', '_' or '-', "
            "a letter or digit first."
        )
    return name


def name_in(key: str) -> str:
    """The name of the process that asks or tells at ``key``, one of those that have a name."""
    return key.rsplit("/", 1)[-1]


@dataclass
class RunKeys:
    """Key expressions of one run, all under ``ale-robot/<run>``; ``'*'`` stands for any name."""

    run: str
    run_id: str = ""
    """Identity of the run that was joined (see `Announcement`): another one may take its name."""

    def __post_init__(self) -> None:
        self._root = root = f"{NAMESPACE}/{self.run}"
        self.all = f"{root}/**"
        """Everything that is said of the run."""
        self.config = f"{root}/config"
        """Query: the run's `RunConfig`; ``RunKeys('*').config`` finds the run itself."""
        self.sample = f"{root}/sample"
        """Query for a minibatch."""
        self.priorities = f"{root}/priorities"
        """Query with new priorities of sampled steps."""
        self.held_out = f"{root}/held_out"
        """Query for states on which the mean max-Q is measured."""
        self.progress = f"{root}/progress"
        """Query for the replay's counters; the learner also tells its own state with it."""
        self.weights = f"{root}/weights"
        """Published: the newest weights, version in the attachment."""
        self.latest_weights = f"{root}/latest_weights"
        """Query: the newest weights, for those who missed the broadcast."""
        self.status = f"{root}/status"
        """Query: how the run does, as the learner knows it."""

    def insert(self, actor: str) -> str:
        """Query with a chunk, answered when it is stored; ``'*'`` for the server's side."""
        return f"{self._root}/insert/{actor}"

    def task(self, evaluator: str) -> str:
        """Query of an evaluator: which epoch to test next, with that epoch's weights."""
        return f"{self._root}/task/{evaluator}"

    def report(self, evaluator: str) -> str:
        """Query of an evaluator with the games it played."""
        return f"{self._root}/report/{evaluator}"

    def live(self, role: str, name: str) -> str:
        """Liveliness token of a process."""
        return f"{self._root}/live/{role}/{name}"

    def stats(self, role: str, name: str) -> str:
        """Published: a process' own counters, about once a second."""
        return f"{self._root}/stats/{role}/{name}"

    def view(self, role: str, name: str) -> str:
        """Query for what a process' environments show now (`LiveView`), while somebody looks."""
        return f"{self._root}/view/{role}/{name}"

"""`RunKeys`: the key expressions by which the processes of a run speak to each other."""

import re
from dataclasses import dataclass

from common.errors import InputError

NAMESPACE = "ale-robot"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


def check_name(kind: str, name: str) -> str:
    """``name`` if it can be part of a key expression and of a path.

    Raises:
        InputError: it cannot; ``kind`` says what was being named.
    """
    if not _NAME.fullmatch(name):
        raise InputError(
            f"{kind} {name!r} cannot be used: up to 64 letters, digits, '.', '_' or '-', "
            "a letter or digit first."
        )
    return name


@dataclass(frozen=True)
class RunKeys:
    """Key expressions of one run, all under ``ale-robot/<run>``."""

    run: str

    def _key(self, *parts: str) -> str:
        return "/".join((NAMESPACE, self.run, *parts))

    @property
    def all(self) -> str:
        """Everything that is said of the run."""
        return self._key("**")

    @property
    def config(self) -> str:
        """Query: the run's `RunConfig`; ``RunKeys('*').config`` finds the run itself."""
        return self._key("config")

    def insert(self, actor: str) -> str:
        """Query with a chunk, answered when it is stored; ``'*'`` for the server's side."""
        return self._key("insert", actor)

    @property
    def sample(self) -> str:
        """Query for a minibatch."""
        return self._key("sample")

    @property
    def priorities(self) -> str:
        """Query with new priorities of sampled steps."""
        return self._key("priorities")

    @property
    def held_out(self) -> str:
        """Query for states on which the mean max-Q is measured."""
        return self._key("held_out")

    @property
    def progress(self) -> str:
        """Query for the replay's counters; the learner also tells its own state with it."""
        return self._key("progress")

    @property
    def weights(self) -> str:
        """Published: the newest weights, version in the attachment."""
        return self._key("weights")

    @property
    def latest_weights(self) -> str:
        """Query: the newest weights, for those who missed the broadcast."""
        return self._key("latest_weights")

    @property
    def task(self) -> str:
        """Query of an evaluator: which epoch to test next, with that epoch's weights."""
        return self._key("task")

    @property
    def report(self) -> str:
        """Query of an evaluator with the games it played."""
        return self._key("report")

    def live(self, role: str, name: str) -> str:
        """Liveliness token of a process."""
        return self._key("live", role, name)

    def stats(self, role: str, name: str) -> str:
        """Published: a process' own counters, about once a second."""
        return self._key("stats", role, name)

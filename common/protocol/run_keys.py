"""`RunKeys`: the key expressions by which the processes of a run communicate."""

import hashlib
import re
from dataclasses import dataclass

from common.checked import MAX_NAME, NAME
from common.errors import InputError, MessageError

NAMESPACE = "ale-robot"
DEMONSTRATIONS = "demonstrations"
"""Name of the actor as which a learner sends recorded games."""


def check_name(kind: str, name: str) -> str:
    """Returns ``name`` if it can be part of a key expression and of a path. Raises InputError if
    not; ``kind`` says what it names."""
    if not re.fullmatch(NAME, name):
        raise InputError(
            f"{kind} {name!r} cannot be used: give it a name of up to {MAX_NAME} letters, digits, "
            "'.', '_' or '-', a letter or digit first."
        )
    return name


def run_id_of(replay: str, settings: str) -> str:
    """Returns the identity of the run with the ``replay``, a UUID, and ``settings`` as JSON."""
    return f"{replay}-{hashlib.sha256(settings.encode()).hexdigest()[:16]}"


def replay_of(run_id: str) -> str:
    """Returns the part of a run's identity that stays when its settings get new fields, after an
    update of the software."""
    return run_id.partition("-")[0]


def name_in(key: str) -> str:
    """Returns the name of the process in ``key``, a key with a name. Raises MessageError if no
    process can have it, such as one that is longer than others."""
    name = key.rsplit("/", 1)[-1]
    if not re.fullmatch(NAME, name):
        raise MessageError("no process can have the name in this key")
    return name


@dataclass
class RunKeys:
    """Key expressions of one run, all under ``ale-robot/<run>``; ``'*'`` stands for any name."""

    run: str
    run_id: str = ""
    """Identity of the run that was joined (see `Announcement`), as another may take its name."""

    def __post_init__(self) -> None:
        self._root = root = f"{NAMESPACE}/{self.run}"
        self.all = f"{root}/**"
        """All keys of the run."""
        self.config = f"{root}/config"
        """Query: the run's `Announcement`; ``RunKeys('*').config`` finds the run itself."""
        self.sample = f"{root}/sample"
        """Query for a minibatch, with new priorities of steps that were drawn before."""
        self.held_out = f"{root}/held_out"
        """Query for states on which the mean max-Q is measured."""
        self.progress = f"{root}/progress"
        """Query for the replay's counters, which also tells the replay the run's goal."""
        self.weights = f"{root}/weights"
        """Published: the newest weights, with the version in the attachment."""
        self.latest_weights = f"{root}/latest_weights"
        """Query: the newest weights, for processes that missed the broadcast."""
        self.status = f"{root}/status"
        """Query: the status of the run, as the learner knows it."""

    def insert(self, actor: str) -> str:
        """Query with a chunk, answered when it is stored; the server uses ``'*'``."""
        return f"{self._root}/insert/{actor}"

    def job(self, evaluator: str) -> str:
        """Query of an evaluator for its next job, with the epoch to test and its weights."""
        return f"{self._root}/job/{evaluator}"

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
        """Query for the view of a process' environment (`LiveView`), while somebody watches."""
        return f"{self._root}/view/{role}/{name}"

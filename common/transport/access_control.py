"""Access control: what each process may do at a hub that knows it by its certificate.

A certificate names a role. An actor's certificate may also name the actor, which then cannot act
in another's name. A replay's certificate names its run, and the replay answers only for that run.
Incoming messages are checked; outgoing ones reach only processes that were allowed to ask for
them. Everything else is denied without notice: a denied query gets no answer, and a denied
publication is dropped.
"""

from collections.abc import Sequence
from typing import Any, get_args

from common.protocol.actor_stats import MAX_HEARTBEATS, Role
from common.protocol.live_view import MAX_VIEW_BYTES
from common.protocol.run_keys import DEMONSTRATIONS, RunKeys
from common.protocol.wire import MAX_MESSAGE_BYTES
from common.transport.credentials import common_name

MAX_SESSIONS = 4_096
"""Maximum number of processes, of all runs, at one hub; fewer if it may have few open files."""
_ANY = RunKeys("*")
_LEARNER_ANSWERS = [_ANY.job("*"), _ANY.report("*"), _ANY.status]
_LEARNER = {
    "query": [
        *(_ANY.config, _ANY.sample, _ANY.held_out, _ANY.progress),
        *(_ANY.status, _ANY.view("*", "*"), _ANY.insert(DEMONSTRATIONS)),
    ],
    "put": [_ANY.weights, _ANY.stats("actor", DEMONSTRATIONS)],
    "liveliness_token": [_ANY.live("actor", DEMONSTRATIONS)],
    "declare_subscriber": [_ANY.stats("*", "*")],
    "declare_liveliness_subscriber": [_ANY.live("*", "*")],
    "declare_queryable": _LEARNER_ANSWERS,
    "reply": _LEARNER_ANSWERS,
}
"""By Zenoh's name of a message, the keys to which a learner may send such messages."""


def _of_actor(name: str) -> dict[str, list[str]]:
    """Returns the same for an actor or evaluator called ``name``; ``'*'`` stands for any name."""
    views = [_ANY.view(role, name) for role in get_args(Role)]
    return {
        "query": [
            *(_ANY.config, _ANY.latest_weights),
            *(_ANY.insert(name), _ANY.job(name), _ANY.report(name)),
        ],
        "put": [_ANY.stats(role, name) for role in get_args(Role)],
        "liveliness_token": [_ANY.live(role, name) for role in get_args(Role)],
        "declare_subscriber": [_ANY.weights],
        "declare_queryable": views,
        "reply": views,
    }


def _of_replay(run: str) -> dict[str, list[str]]:
    """Returns the same for the replay of ``run`` at another run's hub."""
    keys = RunKeys(run)
    served = [
        *(keys.config, keys.latest_weights, keys.sample, keys.held_out, keys.progress),
        keys.insert("*"),
    ]
    return {
        "query": [_ANY.config],
        "declare_subscriber": [keys.weights],
        "declare_queryable": served,
        "reply": served,
    }


_KIB = 1024
_TO_HUB = ["put", "query"]
_MAX_BYTES: list[tuple[list[str], int, list[str]]] = [
    (
        _TO_HUB,
        64 * _KIB,
        [
            *(_ANY.config, _ANY.latest_weights, _ANY.job("*"), _ANY.status, _ANY.view("*", "*")),
            *(_ANY.held_out, _ANY.progress, _ANY.stats("*", "*"), _ANY.report("*")),
        ],
    ),
    (["reply"], 2 * MAX_VIEW_BYTES, [_ANY.view("*", "*")]),
    (_TO_HUB, 4 * _KIB**2, [_ANY.sample]),
    (_TO_HUB, 32 * _KIB**2, [_ANY.insert("*")]),
]
"""Maximum size of incoming messages by kind and key: twice that of the longest that is sent. All
others are bounded by `MAX_MESSAGE_BYTES`."""


LONGEST_RECEIVED = MAX_MESSAGE_BYTES + 64 * _KIB
"""Maximum size of a message that a process receives, bytes. Zenoh's own limit is 1 GiB, which it
would allocate before any check. Zenoh's additions to a message, and its other messages, are
small."""


def size_limits() -> dict[str, Any]:
    """Returns Zenoh's settings by which a hub drops long messages before they take memory."""
    return {
        "low_pass_filter": [
            {
                "id": f"at-most-{most}",
                "flows": ["ingress"],
                "messages": messages,
                "key_exprs": keys,
                "size_limit": most,
            }
            for messages, most, keys in _MAX_BYTES
        ],
    }


_MAX_PER_SECOND = {
    _ANY.stats("*", "*"): MAX_HEARTBEATS,
    _ANY.config: 20,
    _ANY.job("*"): 20,
    _ANY.status: 20,
    _ANY.latest_weights: 5,  # each answer has megabytes
}
"""Maximum rate, per second, of one process' messages at a key: many times the rate of our own
processes. It also sets the shortest time between two messages. Honest actors send several chunks at
once, so a `LeakyBucket` per name limits chunks, and reports, where they are accepted."""


def rate_limits() -> list[dict[str, Any]]:
    """Returns Zenoh's setting ``downsampling``, which drops what a connection sends too often."""
    return [
        {
            "id": "rates",
            "flows": ["ingress"],
            "messages": _TO_HUB,
            "rules": [{"key_expr": key, "freq": most} for key, most in _MAX_PER_SECOND.items()],
        }
    ]


def access_control(actors: Sequence[str] | None, runs: Sequence[str]) -> dict[str, Any]:
    """Returns Zenoh's setting ``access_control`` for a hub.

    Args:
        actors: names of the actors that may join, each by a certificate of its own; None lets any
            actor join by the certificate of the role.
        runs: runs whose replays may join, each by a certificate of its own.
    """
    allowed = {"learner": _LEARNER}
    allowed |= {common_name("replay", run): _of_replay(run) for run in runs}
    if actors is None:
        allowed[common_name("actor")] = _of_actor("*")
    else:
        allowed |= {common_name("actor", name): _of_actor(name) for name in actors}
    rules = [
        {
            "id": f"{subject}-{message}",
            "permission": "allow",
            "flows": ["ingress"],
            "messages": [message],
            "key_exprs": keys,
        }
        for subject, messages in allowed.items()
        for message, keys in messages.items()
    ]
    rules.append(
        {
            "id": "answers",
            "permission": "allow",
            "flows": ["egress"],
            "messages": [
                *("put", "delete", "query", "reply"),
                *("declare_subscriber", "declare_queryable"),
                *("liveliness_token", "liveliness_query", "declare_liveliness_subscriber"),
            ],
            "key_exprs": [_ANY.all],
        }
    )
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": subject, "cert_common_names": [subject]} for subject in allowed],
        "policies": [
            {
                "subjects": [subject],
                "rules": [*(f"{subject}-{message}" for message in messages), "answers"],
            }
            for subject, messages in allowed.items()
        ],
    }

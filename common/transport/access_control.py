"""What each process may do at a hub that knows it by its certificate.

A certificate names a role, and that of an actor can name the actor too: then it may speak in no
other's name. That of a replay names its run, for which alone it answers. What comes in is checked;
what goes out goes only to who was let ask for it. All else is denied, and nobody is told: to a
denied query there is no answer, and a denied publication is dropped.
"""

from collections.abc import Sequence
from typing import Any

from common.protocol.actor_stats import MOST_HEARTBEATS
from common.protocol.live_view import MAX_VIEW_BYTES
from common.protocol.run_keys import DEMONSTRATIONS, RunKeys
from common.protocol.wire import MAX_MESSAGE_BYTES
from common.transport.credentials import common_name

MOST_SESSIONS = 4_096
"""Processes of all runs at one hub, fewer where it may have few open files."""
_ANY = RunKeys("*")
_WORKERS = ("actor", "evaluator")
_LEARNER_ANSWERS = [_ANY.task("*"), _ANY.report("*"), _ANY.status]
_LEARNER = {
    "query": [
        *(_ANY.config, _ANY.sample, _ANY.priorities, _ANY.held_out, _ANY.progress),
        *(_ANY.status, _ANY.view("*", "*"), _ANY.insert(DEMONSTRATIONS)),
    ],
    "put": [_ANY.weights, _ANY.stats("actor", DEMONSTRATIONS)],
    "liveliness_token": [_ANY.live("actor", DEMONSTRATIONS)],
    "declare_subscriber": [_ANY.stats("*", "*")],
    "declare_liveliness_subscriber": [_ANY.live("*", "*")],
    "declare_queryable": _LEARNER_ANSWERS,
    "reply": _LEARNER_ANSWERS,
}
"""By Zenoh's name of a message, the keys to which a learner may send it."""


def _of_actor(name: str) -> dict[str, list[str]]:
    """The same for an actor or evaluator called ``name``; ``'*'`` for one of any name."""
    views = [_ANY.view(role, name) for role in _WORKERS]
    return {
        "query": [
            *(_ANY.config, _ANY.latest_weights),
            *(_ANY.insert(name), _ANY.task(name), _ANY.report(name)),
        ],
        "put": [_ANY.stats(role, name) for role in _WORKERS],
        "liveliness_token": [_ANY.live(role, name) for role in _WORKERS],
        "declare_subscriber": [_ANY.weights],
        "declare_queryable": views,
        "reply": views,
    }


def _of_replay(run: str) -> dict[str, list[str]]:
    """The same for the replay of ``run``, at the hub of another."""
    keys = RunKeys(run)
    served = [
        *(keys.config, keys.latest_weights, keys.sample, keys.priorities, keys.held_out),
        *(keys.progress, keys.insert("*")),
    ]
    return {
        "query": [_ANY.config],
        "declare_subscriber": [keys.weights],
        "declare_queryable": served,
        "reply": served,
    }


_KIB = 1024
_TO_HUB = ["put", "query"]
_MOST_BYTES: list[tuple[list[str], int, list[str]]] = [
    (
        _TO_HUB,
        64 * _KIB,
        [
            *(_ANY.config, _ANY.latest_weights, _ANY.task("*"), _ANY.status, _ANY.view("*", "*")),
            *(_ANY.sample, _ANY.held_out, _ANY.progress, _ANY.stats("*", "*"), _ANY.report("*")),
        ],
    ),
    (["reply"], 2 * MAX_VIEW_BYTES, [_ANY.view("*", "*")]),
    (_TO_HUB, 4 * _KIB**2, [_ANY.priorities]),
    (_TO_HUB, 32 * _KIB**2, [_ANY.insert("*")]),
]
"""What may come in at most, by message and key: twice the longest that anybody sends. All else is
bounded by `MAX_MESSAGE_BYTES`."""


LONGEST_RECEIVED = MAX_MESSAGE_BYTES + 64 * _KIB
"""Bytes of a message that any process receives at most; Zenoh's own 1 GiB would be taken before
anything is looked at. What Zenoh itself adds to a message, and its other messages, are small."""


def size_limits() -> dict[str, Any]:
    """Zenoh's settings by which a hub drops what is too long before it takes memory."""
    return {
        "low_pass_filter": [
            {
                "id": f"at-most-{most}",
                "flows": ["ingress"],
                "messages": messages,
                "key_exprs": keys,
                "size_limit": most,
            }
            for messages, most, keys in _MOST_BYTES
        ],
    }


_MOST_PER_SECOND = {
    _ANY.stats("*", "*"): MOST_HEARTBEATS,
    _ANY.config: 20,
    _ANY.task("*"): 20,
    _ANY.status: 20,
    _ANY.latest_weights: 5,  # each is answered with megabytes
}
"""How often one process may tell or ask at a key: many times as often as ours do, and not sooner
after another. Honest actors send several chunks at once, so chunks, and reports, have a
`LeakyBucket` by name where they are taken."""


def rate_limits() -> list[dict[str, Any]]:
    """Zenoh's setting ``downsampling``, of what one connection sends too often."""
    return [
        {
            "id": "rates",
            "flows": ["ingress"],
            "messages": _TO_HUB,
            "rules": [{"key_expr": key, "freq": most} for key, most in _MOST_PER_SECOND.items()],
        }
    ]


def access_control(actors: Sequence[str] | None = None, runs: Sequence[str] = ()) -> dict[str, Any]:
    """Zenoh's setting of that name for a hub.

    Args:
        actors: names of those that may join, each by a certificate of its own; None for any, all
            by the certificate of their role.
        runs: whose replays may join, each by a certificate of its own.
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

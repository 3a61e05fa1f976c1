"""What each role may do at a hub that knows roles by their certificates.

What comes in is checked; what goes out goes only to who was let ask for it. All else is denied, and
nobody is told: to a denied query there is no answer, and a denied publication is dropped.
"""

from typing import Any

from common.protocol.live_view import MAX_VIEW_BYTES
from common.protocol.run_keys import RunKeys
from common.protocol.wire import MAX_MESSAGE_BYTES

_ANY = RunKeys("*")
_WORKERS = ("actor", "evaluator")
_ALLOWED: dict[str, dict[str, list[str]]] = {
    "actor": {
        "query": [
            _ANY.config,
            _ANY.insert("*"),
            _ANY.latest_weights,
            _ANY.task,
            _ANY.report,
        ],
        "put": [_ANY.stats(role, "*") for role in _WORKERS],
        "liveliness_token": [_ANY.live(role, "*") for role in _WORKERS],
        "declare_subscriber": [_ANY.weights],
        "declare_queryable": [_ANY.view(role, "*") for role in _WORKERS],
        "reply": [_ANY.view(role, "*") for role in _WORKERS],
    },
    "learner": {
        "query": [
            *(_ANY.config, _ANY.sample, _ANY.priorities, _ANY.held_out, _ANY.progress),
            *(_ANY.status, _ANY.view("*", "*")),
        ],
        "put": [_ANY.weights],
        "declare_subscriber": [_ANY.stats("*", "*")],
        "declare_liveliness_subscriber": [_ANY.live("*", "*")],
        "declare_queryable": [_ANY.task, _ANY.report, _ANY.status],
        "reply": [_ANY.task, _ANY.report, _ANY.status],
    },
}
"""By role and Zenoh's name of a message, the keys to which it may be sent."""


_KIB = 1024
_TO_HUB = ["put", "query"]
_MOST_BYTES: list[tuple[list[str], int, list[str]]] = [
    (
        _TO_HUB,
        64 * _KIB,
        [
            *(_ANY.config, _ANY.latest_weights, _ANY.task, _ANY.status, _ANY.view("*", "*")),
            *(_ANY.sample, _ANY.held_out, _ANY.progress, _ANY.stats("*", "*")),
        ],
    ),
    (["reply"], 2 * MAX_VIEW_BYTES, [_ANY.view("*", "*")]),
    (_TO_HUB, 4 * _KIB**2, [_ANY.report, _ANY.priorities]),
    (_TO_HUB, 32 * _KIB**2, [_ANY.insert("*")]),
]
"""What may come in at most, by message and key: twice the longest that anybody sends. All else is
bounded by `MAX_MESSAGE_BYTES`."""


def size_limits() -> dict[str, Any]:
    """Zenoh's settings by which a hub drops what is too long before it takes memory."""
    return {
        # What Zenoh itself adds to a message, and its other messages, are small.
        "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES + 64 * _KIB,
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


def access_control() -> dict[str, Any]:
    """Zenoh's setting of that name for a hub."""
    rules = [
        {
            "id": f"{role}-{message}",
            "permission": "allow",
            "flows": ["ingress"],
            "messages": [message],
            "key_exprs": keys,
        }
        for role, messages in _ALLOWED.items()
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
        "subjects": [{"id": role, "cert_common_names": [role]} for role in _ALLOWED],
        "policies": [
            {
                "subjects": [role],
                "rules": [*(f"{role}-{message}" for message in messages), "answers"],
            }
            for role, messages in _ALLOWED.items()
        ],
    }

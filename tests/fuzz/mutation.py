"""Messages that are nearly right: another value, key, length or type somewhere inside msgpack."""

import random
from typing import Any

import msgpack

_VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 7, 2**31 - 1, 2**31, 2**63 - 1, 2**64 - 1, -(2**63),
    0.0, -0.0, 0.5, 1e9, 1e308, float("inf"), float("-inf"), float("nan"),
    "", "a", "\0", "a/b", "*", "../x", "x" * 300, "é🤖", b"", b"\0", b"\xff" * 65,
    [], [0], [[]], [1] * 20_000, {}, {"a": 1}, {"schema": 7},
)  # fmt: skip


def mutate(message: bytes, chance: random.Random) -> bytes:
    """Returns ``message`` with one to three changes; bytes are changed where it is no msgpack."""
    for _ in range(chance.randint(1, 3)):
        message = _change(message, chance)
    return message


def _change(message: bytes, chance: random.Random) -> bytes:
    try:
        content = msgpack.unpackb(message, strict_map_key=False)
    except (TypeError, ValueError, msgpack.UnpackException):
        content = None
    places = list(_places(content)) if isinstance(content, dict) else []
    if not places or chance.random() < 0.2:
        return _damage(message, chance)
    holder, key = chance.choice(places)
    match chance.randrange(5):
        case 0 if isinstance(holder, dict):
            del holder[key]
        case 1 if isinstance(holder, dict):
            holder[chance.choice(("", "schema", "data", "x" * 40))] = holder[key]
        case 2 if isinstance(holder[key], bytes | str | list) and holder[key]:
            holder[key] = holder[key][: chance.randrange(len(holder[key]))]
        case 3 if type(holder[key]) in (int, float):
            holder[key] += chance.choice((-1, 1, 0.5))
        case 3 | 4 if isinstance(holder[key], msgpack.ExtType):  # compressed bytes
            code, data = holder[key]
            holder[key] = msgpack.ExtType(chance.choice((code, code, 0, 7)), _damage(data, chance))
        case _:
            holder[key] = chance.choice(_VALUES)
    try:
        return bytes(msgpack.packb(content))
    except (ValueError, OverflowError):  # a whole number that msgpack does not have
        return message


def _places(content: Any) -> Any:
    """All places inside, as a container and its key."""
    keys = content if isinstance(content, dict) else range(len(content))
    for key in list(keys):
        yield content, key
        if isinstance(content[key], dict | list):
            yield from _places(content[key])


def _damage(message: bytes, chance: random.Random) -> bytes:
    damaged = bytearray(message)
    place = chance.randrange(len(damaged) + 1)
    match chance.randrange(4):
        case 0:
            del damaged[place:]
        case 1:
            damaged[place:place] = chance.randbytes(chance.randint(1, 9))
        case 2 if place < len(damaged):
            damaged[place] = chance.randrange(256)
        case _:
            damaged[place:place] = damaged[:place][-64:]
    return bytes(damaged)

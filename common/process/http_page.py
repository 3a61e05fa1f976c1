"""`Page`: what a process answers over HTTP. It needs no package, unlike the server."""

from collections.abc import Sequence
from typing import NamedTuple


class Page(NamedTuple):
    """The response to a request for one path."""

    body: bytes
    kind: str = "text/plain; charset=utf-8"
    status: int = 200


def verdict(reasons: Sequence[str]) -> Page:
    """Returns ``ok``; or, with status 503, the ``reasons`` why not, one per line."""
    if not reasons:
        return Page(b"ok\n")
    return Page("".join(f"{reason}\n" for reason in reasons).encode(), status=503)

"""`Link`: a network between two processes that fails without either being told."""

import random
import socket
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Self

from benchmarks.child import free_endpoint
from common.transport.endpoint import check_endpoint

_AT_ONCE = struct.pack("ii", 1, 0)
"""Closes a connection by a reset."""


class Link:
    """Carries bytes between an address of its own and a hub's; a context manager.

    While it is cut nothing arrives, not even that somebody hung up; as in a network, what was on
    its way arrives when it is mended, if there is still somebody to take it.
    """

    def __init__(self, hub: str) -> None:
        self._hub = check_endpoint(hub)
        self.endpoint = free_endpoint()
        """Where the hub is found through this link."""
        self._listener = socket.create_server(check_endpoint(self.endpoint))
        self._whole = threading.Event()
        self._whole.set()
        self._sockets: list[socket.socket] = []
        self.delay: Callable[[], float] | None = None
        """Draws the seconds that a piece of at most 64 KiB waits on its way; None for none."""
        self.flips: random.Random | None = None
        """Draws the bit that is wrong in each piece; None for none."""
        self._forgotten: list[threading.Event] = []

    def __enter__(self) -> Self:
        self._start(self._accept)
        return self

    def __exit__(self, *_: object) -> None:
        self.mend()
        for each in self._forgotten:
            each.set()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.reset()

    def cut(self) -> Callable[[], None]:
        """Nothing arrives any more; returns what mends it."""
        self._whole.clear()
        return self.mend

    def forget(self) -> None:
        """What is connected stays so for ever, and nothing arrives; who connects anew is served.

        A router that restarted and has forgotten the connection does the same.
        """
        self._whole, before = threading.Event(), self._whole
        before.clear()
        self._forgotten.append(before)
        self._whole.set()

    def mend(self) -> None:
        """All arrives again, whole and at once."""
        self.delay = self.flips = None
        self._whole.set()

    def reset(self) -> None:
        """Hang up on both sides; they may connect again."""
        sockets, self._sockets = self._sockets, []
        for each in sockets:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _start(self, target: Callable[..., None], *args: Any) -> None:
        threading.Thread(target=target, args=args, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):  # closed
            while True:
                near, _ = self._listener.accept()
                self._sockets.append(near)
                self._start(self._join, near)

    def _join(self, near: socket.socket) -> None:
        whole = self._whole
        whole.wait()
        with suppress(OSError):  # no hub is there: hang up
            far = socket.create_connection(self._hub)
            self._sockets.append(far)
            self._start(self._carry, far, near, whole)
            self._carry(near, far, whole)
        near.close()

    def _carry(self, source: socket.socket, sink: socket.socket, whole: threading.Event) -> None:
        try:
            while content := source.recv(65_536):
                if (delay := self.delay) is not None:
                    time.sleep(delay())
                whole.wait()
                sink.sendall(self._spoiled(content))
        except OSError:
            # Whoever sends to one that has gone is told so by that one's machine.
            whole.wait()
            with suppress(OSError):
                source.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _AT_ONCE)
            source.close()
        whole.wait()
        with suppress(OSError):
            sink.shutdown(socket.SHUT_RDWR)

    def _spoiled(self, content: bytes) -> bytes:
        if (flips := self.flips) is None:
            return content
        spoiled = bytearray(content)
        spoiled[flips.randrange(len(spoiled))] ^= 1 << flips.randrange(8)
        return bytes(spoiled)

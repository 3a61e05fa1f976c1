"""`Link`: a network between two processes, which can fail without either noticing."""

import random
import socket
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Self

from benchmarks.child import free_endpoint
from common.endpoint import check_endpoint

_AT_ONCE = struct.pack("ii", 1, 0)
"""Socket option that closes a connection with a reset."""


class Link:
    """Carries bytes between an address of its own and a hub's; a context manager.

    While it is cut nothing arrives, not even the end of a connection. As in a network, what was on
    its way arrives when the link is mended, if its receiver still exists.
    """

    def __init__(self, hub: str) -> None:
        self._hub = check_endpoint(hub)
        self.endpoint = free_endpoint()
        """Address at which the hub is reached through this link."""
        self._listener = socket.create_server(check_endpoint(self.endpoint))
        self._whole = threading.Event()
        self._whole.set()
        self._sockets: list[socket.socket] = []
        self.delay: Callable[[], float] | None = None
        """Draws the delay, in seconds, of a piece of at most 64 KiB; None for no delay."""
        self.flips: random.Random | None = None
        """Draws the bit that is flipped in each piece; None for no flips."""
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
        """Lets nothing arrive any more; returns a function that mends the link."""
        self._whole.clear()
        return self.mend

    def forget(self) -> None:
        """Lets nothing arrive on present connections, which stay open; new connections work.

        A router that restarted and forgot its connections does the same.
        """
        self._whole, before = threading.Event(), self._whole
        before.clear()
        self._forgotten.append(before)
        self._whole.set()

    def mend(self) -> None:
        """Lets everything arrive again, unchanged and without delay."""
        self.delay = self.flips = None
        self._whole.set()

    def reset(self) -> None:
        """Closes all connections on both sides; they may connect again."""
        sockets, self._sockets = self._sockets, []
        for each in sockets:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _start(self, target: Callable[..., None], *args: Any) -> None:
        threading.Thread(target=target, args=args, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):  # the link was closed
            while True:
                near, _ = self._listener.accept()
                self._sockets.append(near)
                self._start(self._join, near)

    def _join(self, near: socket.socket) -> None:
        whole = self._whole
        whole.wait()
        with suppress(OSError):  # without a hub, close the connection
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
            # While the link is cut, a sender cannot learn that its receiver has gone.
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

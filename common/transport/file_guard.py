"""`FileGuard`: refuses new connections while a hub has too many files open.

A process that may open no more files fails wherever it opens one, and a stranger can make thousands
of connections per second. At a ``tls/`` address, Zenoh gives connections without a certificate ten
seconds, does not count them, and then closes only ten per second (its pause after each).
"""

import logging
import threading

from common.process.threads import repeat
from common.transport.hub_sockets import Door, open_files

_LOOK = 0.05
"""Seconds between two looks; fewer connections should come in this time than files are left."""
_LOOK_AGAIN = 1.0
"""Seconds between two looks while new connections are refused."""
_log = logging.getLogger(__name__)


class FileGuard:
    """Counts the open files of this process, a hub at ``port``, until it is closed.

    Args:
        most: maximum number of files that the process may have open. Three eighths are for sessions
            (`MAX_SESSIONS`), and three for connections that come between two looks; strangers
            have the rest.
    """

    def __init__(self, port: int, most: int) -> None:
        self._port = port
        self._enough = most * 5 // 8
        self._door = Door(port, most // 8)
        self._end = repeat("file-guard", _LOOK, self._look)

    def close(self) -> None:
        """Stops counting."""
        self._end()
        self._door.close()

    def _look(self, closed: threading.Event) -> None:
        if (count := open_files()) <= self._enough:
            return
        self._door.shut()
        text = "%d files and connections are open: nobody is let in at port %d until some end"
        _log.warning(text, count, self._port)
        while open_files() > self._enough and not closed.wait(_LOOK_AGAIN):
            pass
        self._door.open()

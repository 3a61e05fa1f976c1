"""`FileGuard`: lets nobody in for as long as a hub has too many files open.

A process without a file left fails wherever it opens one, and a stranger makes thousands of
connections a second. At a ``tls/`` address Zenoh gives those that show no certificate ten seconds,
counts none of them, and then lets go of ten a second only (its pause after each).
"""

import logging
import threading

from common.process.threads import repeat
from common.transport.hub_sockets import Door, open_files

_LOOK = 0.05
"""Seconds in which no more should come than there are files left."""
_LOOK_AGAIN = 1.0
"""Seconds between two looks while nobody is let in."""
_log = logging.getLogger(__name__)


class FileGuard:
    """Counts the files of this process, a hub at ``port``, until it is closed.

    Args:
        most: files that it may have open. Three eighths are for sessions (`MOST_SESSIONS`), and as
            many again for what comes before it is seen; strangers have what is left.
    """

    def __init__(self, port: int, most: int) -> None:
        self._port = port
        self._enough = most * 5 // 8
        self._door = Door(port, most // 8)
        self._end = repeat("file-guard", _LOOK, self._look)

    def close(self) -> None:
        """Count no more."""
        self._end()
        self._door.close()

    def _look(self, closed: threading.Event) -> None:
        if (count := open_files()) <= self._enough:
            return
        self._door.shut()
        text = "%d files and connections are open: until some end nobody is let in at port %d"
        _log.warning(text, count, self._port)
        while open_files() > self._enough and not closed.wait(_LOOK_AGAIN):
            pass
        self._door.open()

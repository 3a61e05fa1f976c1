"""Asking the pages of a process."""

import urllib.error
import urllib.request

from tests.patience import PATIENCE


def get(address: str, path: str, method: str = "GET", **headers: str) -> tuple[int, str]:
    """Returns the status and the text of ``path`` at ``address``, HOST:PORT."""
    request = urllib.request.Request(f"http://{address}{path}", method=method, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()

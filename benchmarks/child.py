"""What a benchmark with processes of its own needs: an address for them, and a way to end."""

import signal
import socket


def free_endpoint() -> str:
    """An address of this machine at which nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def end_as_by_ctrl_c() -> None:
    """Let SIGTERM unwind this process, so that nothing it started is left behind."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)

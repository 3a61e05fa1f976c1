"""A router between a hub and its actors, in a process of its own, for `benchmarks.many_actors`."""

from benchmarks.child import Helper, serve
from common.transport.zenoh_sessions import open_router


class SecondRouter:
    """Routes messages between clients at ``listen`` and the hub at ``connect_to``.

    It is ready when it answers.
    """

    def __init__(self, listen: str, connect_to: str) -> None:
        self._transport = open_router(listen, connect_to)

    def ready(self) -> bool:
        return True


def second_router(listen: str, connect_to: str) -> Helper:
    """Starts a router and returns it when it is ready; a context manager that ends it."""
    router = Helper(
        "the second router", "benchmarks.second_router", listen=listen, connect_to=connect_to
    )
    router.ask("ready")
    return router


if __name__ == "__main__":
    serve(SecondRouter)

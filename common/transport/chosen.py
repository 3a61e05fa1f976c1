"""The transport by which the processes of a run communicate. To use another one, change it here.

Actors, learner, replay and benchmarks call only these two functions. Both return a
`common.transport.interface.Transport`.
"""

from common.transport.zenoh_sessions import connect, open_hub

__all__ = ["connect", "open_hub"]

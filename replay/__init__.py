"""The replay: transitions, stored once and sampled many times.

The `Store` consists of columns, ring, chunk index, journal and samplers. The `ReplayBuffer` adds
the rate limiter; a learner may hold it in its own process. `ReplayServer` and `RemoteReplay` carry
the same calls to another process.
"""

"""The replay: transitions, stored once and sampled many times.

Columns, ring, chunk index, journal and samplers make the `Store`. With the rate limiter it is the
`ReplayBuffer`, which a learner may hold in its own process. `ReplayServer` and `RemoteReplay` carry
the same calls to another process.
"""

"""The replay: what was lived through, stored once, drawn many times.

Columns, ring, ledger, journal and samplers make the `Store`; with the limiter it is the
`ReplayBuffer`,
which a learner has in its own process; `ReplayServer` and `RemoteReplay` carry the same calls
over Zenoh.
"""

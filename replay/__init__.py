"""The replay: what was lived through, stored once, drawn many times.

columns → ring → ledger and journal → samplers and limiter → `Memory`, which the learner uses
in its own process; `ReplayServer` and `RemoteReplay` carry the same calls over Zenoh.
"""

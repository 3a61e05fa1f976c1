"""Chaos: a whole run whose processes and network fail at random, and an independent audit of it.

`cluster` starts the run's processes and the links between them, `faults` breaks them, `witness`
records which chunks each actor made and which the replay acknowledged, and `audit` compares that
with the replay's files.
"""

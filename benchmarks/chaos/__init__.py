"""Chaos: a whole run whose processes and network fail at random, and an independent audit of it.

`cluster` starts the run's processes and the links between them, `faults` breaks them, `witness`
records what each actor made and was told is stored, and `audit` compares that with the replay's
files.
"""

"""What a run is: its settings and presets, the ranges that are drawn, and how all are stored.

`clock` is there too, although how time passes belongs to each process.
"""

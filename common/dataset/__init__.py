"""Recordings of steps: their files, written and read."""

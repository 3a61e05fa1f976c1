"""The web page of a run: its figures, curves and robots in a browser, read-only."""

"""The page of a run: its figures, curves and robots in a browser, to look at only."""

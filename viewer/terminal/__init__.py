"""The terminal as a place for pictures and a source of keys; knows nothing of robots or games."""

"""The terminal as a screen for pictures and a source of keys; it knows nothing of robots."""

"""Hands as a network that was fitted to a real robot's latency, from a file of the user's."""

"""Hands modelled by a network that was fitted to a real robot's latency, from a user's file."""

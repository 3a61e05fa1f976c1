"""Launching a run on engines that a user already has: one description, and a file for each."""

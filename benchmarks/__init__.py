"""Measurements and plots. Every published number comes from one of these commands."""

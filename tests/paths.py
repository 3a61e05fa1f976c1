"""Where the tests find the checkout's other files."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
"""The checkout."""

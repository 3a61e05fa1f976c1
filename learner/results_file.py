"""Checks a file of results before they are measured: it must not hold anything else."""

import json
from pathlib import Path

from common.atomic_file import check_new_file
from common.errors import InputError


def check_results_file(file: Path) -> None:
    """Makes the folder of a file that will get results and their provenance.

    Raises:
        InputError: the file could not be written, or holds anything but earlier results: a run's
            settings would be lost with it.
    """
    check_new_file(file)
    if not file.exists() or not file.stat().st_size:
        return
    try:
        found = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        found = None
    # A run's summary has its provenance too, but with the run's settings.
    if not isinstance(found, dict) or "machine" not in found or "config" in found:
        raise InputError(f"{file} exists and holds no earlier results: name another file.")

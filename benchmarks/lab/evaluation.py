"""`evaluate`: whole games by a trained network, played by `python -m learner --evaluate`.

`lateness` are flags for it.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from common.errors import InputError


def lateness(press: int) -> list[str]:
    """Flags for a modelled hand, whatever hand a network was trained with.

    Args:
        press: frames of 60 Hz until a new command's keys are down; the old one's go at once.
    """
    return [
        "--play.command-latency",
        "0",
        "--play.release-latency",
        "0",
        "--play.press-latency",
        f"{press}",
    ]


def evaluate(
    network: Path, games: int, epsilon: float, flags: Sequence[str] = ()
) -> dict[str, Any]:
    """What the evaluation wrote as JSON; its table goes to the terminal.

    Args:
        flags: in which the settings are not those under which the network was trained.

    Raises:
        InputError: the games cannot be played; why is on the terminal.
    """
    with tempfile.TemporaryDirectory(prefix="ale-robot-") as folder:
        found = Path(folder) / "evaluation.json"
        ended = subprocess.run(
            [
                *(sys.executable, "-m", "learner", "--evaluate", str(network)),
                *("--games", f"{games}", "--epsilon", f"{epsilon}", "--json", str(found)),
                *flags,
            ],
            check=False,
        )
        if ended.returncode:
            raise InputError(f"the games ended with exit code {ended.returncode}, see above.")
        told: dict[str, Any] = json.loads(found.read_bytes())
        return told

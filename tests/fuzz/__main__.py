"""`python -m tests.fuzz TARGET --messages N`: fuzz one target, guided by coverage (Atheris).

It ends with exit code 0 after N messages; without a target it names them all. What a target raises
beside a refusal, and memory beyond `_MAX_MIB`, end it with the message in a file ``crash-…``.
"""

import contextlib
import random
import sys
import tempfile
from pathlib import Path

import atheris
import tyro

with atheris.instrument_imports(include=["actors", "common", "learner", "replay"]):
    from tests.fuzz.mutation import mutate
    from tests.fuzz.targets import REFUSED, Targets

_MAX_MIB = 2_048
_LONGEST = 10
"""Seconds that one message may take."""


def main(target: tyro.conf.Positional[str] = "", messages: int = 100_000, seed: int = 1) -> None:
    """Fuzz one target, or name them all."""
    with tempfile.TemporaryDirectory(prefix="ale-robot-fuzz-") as name:
        folder = Path(name)
        targets = Targets(folder)  # never closed: Atheris ends the process
        if not target:
            print(*targets.all, sep="\n")
            return
        chosen = targets.all[target]
        corpus = folder / "corpus"
        corpus.mkdir()
        for number, message in enumerate(chosen.seeds):
            (corpus / str(number)).write_bytes(message)

        def take(data: bytes) -> None:
            with contextlib.suppress(*REFUSED):
                chosen.take(data)

        def change(data: bytes, most: int, seed: int) -> bytes:
            if seed % 4 == 0:
                return bytes(atheris.Mutate(data, most))
            return mutate(data, random.Random(seed))[:most]

        longest = max(map(len, chosen.seeds))
        flags = (
            f"-runs={messages}", f"-seed={seed}", f"-max_len={2 * longest + 4_096}",
            f"-rss_limit_mb={_MAX_MIB}", f"-timeout={_LONGEST}", "-print_final_stats=1",
        )  # fmt: skip
        atheris.Setup([sys.argv[0], *flags, str(corpus)], take, custom_mutator=change)
        atheris.Fuzz()


if __name__ == "__main__":
    tyro.cli(main, prog="python -m tests.fuzz")

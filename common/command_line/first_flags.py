"""Flags that are read before all others, because defaults or the help depend on them."""

import argparse
from collections.abc import Mapping, Sequence


def read_first(
    arguments: Sequence[str], flags: Mapping[str, Sequence[str]]
) -> tuple[dict[str, str], list[str]]:
    """Returns the values that ``arguments`` give to some ``flags``, and the other arguments.

    If a value is missing, nothing is taken out, so that the error is that of every other flag.

    Args:
        flags: by the name under which a value is returned, the ways to write its flag.
    """
    parser = argparse.ArgumentParser(
        add_help=False, allow_abbrev=False, exit_on_error=False, argument_default=argparse.SUPPRESS
    )
    for name, ways in flags.items():
        parser.add_argument(*ways, dest=name)
    try:
        known, rest = parser.parse_known_args(list(arguments))
    except argparse.ArgumentError:
        return {}, list(arguments)
    return vars(known), rest

"""Flags that a flag holds as quoted text, as in --learner="--play.sticky 0.25"."""

import shlex
from collections.abc import Collection, Sequence

from common.command_line.parser import flag_in
from common.errors import InputError


def quoted_flags(text: str, flag: str, own: Collection[str] = ()) -> list[str]:
    """Returns the words of ``text``, which is the value of ``flag``.

    Args:
        own: flags that the experiment itself gives.

    Raises:
        InputError: a quotation mark is missing in ``text``, or one of ``own`` is in it.
    """
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise InputError(f"{flag} is {text!r} ({error}): quote it whole.") from None
    if refused := sorted(names_of(words) & {*own}):
        raise InputError(f"{flag} names {refused[0]}, which the experiment itself gives: omit it.")
    return words


def names_of(words: Sequence[str]) -> set[str]:
    """Returns the flags among ``words``, without their values."""
    return {flag_in(each) for each in words if each.startswith("--")}

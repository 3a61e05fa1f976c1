"""Declares what an environment reports about a step beside its observation."""

from collections.abc import Mapping
from typing import Any, NamedTuple, get_origin

from common.errors import InputError


class StepInfo(NamedTuple):
    """The ``info`` of a `reset` or `step`: typed here, a dictionary for Gymnasium.

    An environment gives ``StepInfo(...)._asdict()``. The first three fields have no default: every
    environment of this project plays games and must report where one ends.
    """

    game_over: bool
    """Whether the game ended at this step, by its own rules or cut short."""
    game_score: float
    """Points of the game so far, random start included."""
    game_steps: int
    """Agent steps of the game so far, random start included."""
    valid_frame: bool = True
    """Whether the newest frame really shows the game."""
    frame_follows: bool = True
    """Whether frames change as the game's own pictures do."""
    keys_match: bool = True
    """Whether the keys pressed at the step's end were the commanded ones."""
    elapsed: int = 1
    """Agent steps of game time that the step took; 0 for a reset."""
    gave_up: bool = False
    """Whether the wait for the commanded keys ended at its bound, without them."""
    missed_deadlines: int = 0
    """In real time: agent steps that passed before this step's command, and those with a late
    frame. Unless the agent waits for its keys, every agent step after the command's first one
    counts too."""
    late_frames: int = 0
    """In real time: emulator frames of this step that began more than a frame too late."""
    key_times: tuple[int, ...] = ()
    """What `KeyWatch` measured since the last step (see `common.press_latency`); none in a reset.
    """

    @classmethod
    def of(cls, info: Mapping[str, Any]) -> "StepInfo":
        """Returns what ``info`` says, without keys that a wrapper added.

        Raises:
            InputError: a key without a default is missing.
        """
        # Values are converted, because some environments give numpy's types.
        told = {name: kind(info[name]) for name, kind in _TYPES.items() if name in info}
        if missing := _REQUIRED - told.keys():
            raise InputError(
                f"the environment's info lacks {', '.join(sorted(missing))}: give "
                "StepInfo(...)._asdict()."
            )
        return cls(**told)


_TYPES: dict[str, Any] = {
    name: get_origin(kind) or kind for name, kind in StepInfo.__annotations__.items()
}
_REQUIRED = set(StepInfo._fields) - StepInfo._field_defaults.keys()

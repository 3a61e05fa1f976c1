"""What an environment says about a step beside its observation, declared once."""

from collections.abc import Mapping
from typing import Any, NamedTuple, get_origin


class StepInfo(NamedTuple):
    """The ``info`` of a `reset` or `step`: typed here, a dictionary for Gymnasium.

    An environment gives ``StepInfo(...)._asdict()``. The first three have no default: every
    environment of this project plays games and must say where one ends.
    """

    game_over: bool
    """The game ended at this step, by its own rules or cut short."""
    game_score: float
    """Points of the game so far, random start included."""
    game_steps: int
    """Agent steps of the game so far, random start included."""
    valid_frame: bool = True
    """The newest frame really shows the screen."""
    frame_follows: bool = True
    """The newest frame differs from the one before, or the game's own picture did not change."""
    keys_match: bool = True
    """The keys pressed at the step's end were the commanded ones."""
    elapsed: int = 1
    """Agent steps of game time that the step took; 0 for a reset."""
    gave_up: bool = False
    """The wait for the commanded keys ended at its bound, without them."""
    missed_deadlines: int = 0
    """In real time: agent steps that passed before this step's command or, unless the agent waits
    for its keys, after the one that the command was for; and those of which a frame was late."""
    late_frames: int = 0
    """In real time: emulator frames of this step that began more than a frame too late."""
    key_times: tuple[int, ...] = ()
    """What `KeyWatch` measured since the last step (see `common.press_latency`); a reset tells
    none."""

    @classmethod
    def of(cls, info: Mapping[str, Any]) -> "StepInfo":
        """Returns what ``info`` says; the keys that a wrapper added are left out.

        Raises:
            KeyError: one of the keys without a default is missing.
        """
        # Each to its own type, because some environments count in numpy's.
        told = {name: kind(info[name]) for name, kind in _TYPES.items() if name in info}
        if missing := _REQUIRED - told.keys():
            raise KeyError(
                f"info lacks {', '.join(sorted(missing))}: give StepInfo(...)._asdict()."
            )
        return cls(**told)


_TYPES: dict[str, Any] = {
    name: get_origin(kind) or kind for name, kind in StepInfo.__annotations__.items()
}
_REQUIRED = set(StepInfo._fields) - StepInfo._field_defaults.keys()

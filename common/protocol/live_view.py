"""Requests for an actor's live view, for a person who watches the run, and the small pictures that
answer them.

An actor makes pictures only on request. They are JPEG and stay encoded until somebody looks at
them. Their sizes are checked here, so that a few bytes cannot demand a picture of gigabytes.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Le, Lt, MaxLen

from common.actions import KEYS_OF_ACTION, Keys
from common.checked import Count, Score, Values
from common.errors import MessageError
from common.protocol.message import Message
from common.settings.config import MAX_ENVS

ViewName = Literal["room", "hands", "front"]
"""Viewpoint of a person: the robot and its surroundings, its hands on the keys, or the robot from
the front."""
Viewpoint = Literal["none", ViewName]
"""The same for a request; ``none`` needs no rendering beside the robot's own picture."""
MAX_PICTURE_BYTES = 96 * 1024
MAX_SIDE = 640
"""Maximum width and height of a picture, pixels."""
MAX_VIEW_BYTES = 4 * MAX_PICTURE_BYTES
"""Maximum size of a whole `LiveView`."""
VIEW_SECONDS = 5.0
"""Seconds that whoever asks waits for a view: between two slow ones, an actor plays on."""
_START, _SCAN = 0xD8, 0xDA
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
"""Markers of segments that hold the picture's size."""
_BARE = {0x00, 0x01, *range(0xD0, 0xDA), 0xFF}
"""Markers without a length. A reader that skips what follows them, as if they had one, misses the
size that a decoder finds there."""

Jpeg = Annotated[bytes, MaxLen(MAX_PICTURE_BYTES)]
"""A picture; empty if there is none."""
_Keys = Annotated[int, Ge(0), Lt(2 ** len(Keys))]
_Share = Annotated[float, Ge(-10), Le(10)]


@dataclass(frozen=True)
class ViewRequest(Message):
    """Asks an actor for the view of one of its environments."""

    stream: Annotated[int, Ge(0), Lt(MAX_ENVS)] = 0
    """Index of the environment."""
    viewpoint: Viewpoint = "none"


@dataclass(frozen=True)
class LiveView(Message):
    """The view of one environment of an actor after a step."""

    streams: Annotated[int, Ge(1), Le(MAX_ENVS)]
    """Number of environments of the actor."""
    score: Score
    """Points of the game so far."""
    steps: Count
    """Agent steps of the game so far."""
    found: bool
    """Whether the frame shows the screen."""
    explored: bool
    """Whether the action was random."""
    picture: Jpeg
    """What the robot's camera sees, or the emulator's screen."""
    border: Annotated[Values[_Share], MaxLen(8)]
    """Corners (x, y) of the projected picture, as shares of the camera picture's width and height;
    empty if they were not found."""
    game: Annotated[Values[_Share], MaxLen(8)]
    """Corners of the game within the projected picture, in the same form."""
    frame: Jpeg
    """Newest frame of the network's input."""
    room: Jpeg
    """The robot from the requested viewpoint."""
    wanted: _Keys
    """The commanded keys."""
    pressed: _Keys
    """The keys that the game gets."""
    actions: Annotated[Values[Annotated[int, Ge(0), Lt(len(KEYS_OF_ACTION))]], MaxLen(256)]
    """ALE's numbers of the actions; empty if the environment has other actions."""
    values: Annotated[Values[Score], MaxLen(256)]
    """Q-value of each action, in the state that was acted on."""
    chosen: Annotated[int, Ge(0), Lt(256)]
    """Index of the chosen action."""

    def check(self) -> None:
        for corners in (self.border, self.game):
            if len(corners) not in (0, 8):
                raise MessageError("four corners should be eight numbers")
        if len(self.actions) not in (0, len(self.values)) or self.chosen >= len(self.values):
            raise MessageError("each action should have a value")
        for jpeg in (self.picture, self.frame, self.room):
            if jpeg and not all(0 < side <= MAX_SIDE for side in size_of(jpeg)):
                raise MessageError(f"a picture should have 1 to {MAX_SIDE} pixels a side")


def size_of(jpeg: bytes) -> tuple[int, int]:
    """Returns width and height of a JPEG picture, from its headers alone. Raises MessageError if
    the headers do not hold them."""
    at = 0
    while len(jpeg) >= at + 2 and jpeg[at] == 0xFF and jpeg[at + 1] != _SCAN:
        marker = jpeg[at + 1]
        if marker != _START if at == 0 else marker in _BARE:
            break
        if marker in _FRAMES and len(jpeg) >= at + 9:
            height, width = (int.from_bytes(jpeg[at + i : at + i + 2]) for i in (5, 7))
            return width, height
        at += 2 if at == 0 else 2 + int.from_bytes(jpeg[at + 2 : at + 4])
    raise MessageError("a picture should be a JPEG")

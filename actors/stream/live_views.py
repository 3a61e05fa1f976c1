"""Shows an actor's play to those who ask; it costs nothing while nobody does."""

import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.envs.robot import RobotEnv
from actors.envs.shown_env import ShownEnv
from actors.loop import Step
from actors.member import Member
from actors.policy import Policy
from actors.vision.layout import border_of
from common.errors import MessageError
from common.protocol.actor_stats import Role
from common.protocol.live_view import (
    MAX_PICTURE_BYTES,
    MAX_SIDE,
    VIEW_SECONDS,
    LiveView,
    Viewpoint,
    ViewRequest,
)
from common.transport.interface import Request

_MAX_WAITING = 8
_PERIOD = 0.1
"""Minimum seconds between two pictures, however many people ask."""
_REST = 9.0
"""Playing time before the next picture, as a multiple of the time that the last one took: watching
takes at most a tenth of an actor's time."""
_ROOM = (480, 360)
"""Width and height of the robot from outside."""


class _Waiting(NamedTuple):
    request: Request
    asked: ViewRequest
    until: float
    """Monotonic seconds at which nobody awaits the answer any more."""


class LiveViews:
    """Answers requests for pictures between two steps."""

    def __init__(
        self,
        member: Member,
        role: Role,
        envs: Sequence[ShownEnv[Any, Any]],
        policy: Policy,
    ) -> None:
        self._envs = envs
        self._policy = policy
        self._member = member
        self._failed = False
        """Whether an environment failed to give its picture."""
        self._lock = threading.Lock()
        self._waiting: list[_Waiting] = []
        self._next = 0.0
        """Monotonic seconds at which the next picture may be made."""
        member.transport.serve(member.keys.view(role, member.name), self._take)

    def show(self, step: Step) -> None:
        """Answers one request for the environment of ``step``, which was just played."""
        if not self._waiting or (began := time.monotonic()) < self._next:
            return
        with self._lock:
            self._drop_what_nobody_awaits()
            of_step = (each for each in self._waiting if each.asked.stream == step.stream)
            if (first := next(of_step, None)) is None:
                return
            self._waiting.remove(first)
        first.request.reply(self._view(step, first.asked.viewpoint).encode())
        ended = time.monotonic()
        self._next = ended + max(_PERIOD, _REST * (ended - began))

    def _take(self, request: Request) -> None:
        asked = ViewRequest.decode(request.payload)
        if asked.stream >= len(self._envs):
            raise MessageError(f"there are {len(self._envs)} environments here")
        with self._lock:
            self._drop_what_nobody_awaits()
            if len(self._waiting) >= _MAX_WAITING:
                raise MessageError("too many are waiting")
            self._waiting.append(_Waiting(request, asked, time.monotonic() + VIEW_SECONDS))

    def _drop_what_nobody_awaits(self) -> None:
        # An evaluator answers nobody between two tests.
        self._waiting = [each for each in self._waiting if each.until > time.monotonic()]

    def _view(self, step: Step, viewpoint: Viewpoint) -> LiveView:
        env = self._envs[step.stream]
        room = border = game = None
        with env.still():  # or in real time it would move on from picture to picture
            wanted, pressed = int(env.wanted), int(env.pressed)
            picture = self._picture(lambda: env.seen)
            if isinstance(env, RobotEnv):
                game = env.detection.corners
                border = None if game is None else border_of(game)
                if viewpoint != "none":
                    room = self._picture(partial(env.view, *_ROOM, viewpoint))
        values = self._policy.q_values(step.s_tm1[None], step.x_tm1[None])[0]
        return LiveView(
            streams=len(self._envs),
            score=step.info.game_score,
            steps=step.info.game_steps,
            found=step.info.valid_frame,
            explored=step.explored,
            picture=_jpeg(picture),
            border=_shares(border, picture),
            game=_shares(game, picture),
            frame=_jpeg(step.s_t[-1]),
            room=_jpeg(room),
            wanted=wanted,
            pressed=pressed,
            actions=tuple(action for action in env.actions if action is not None),
            values=tuple(values.tolist()),
            chosen=step.a_tm1,
        )

    def _picture(self, take: Callable[[], NDArray[np.uint8]]) -> NDArray[np.uint8] | None:
        """Returns the picture that ``take`` returns; None if it fails, which is told once."""
        try:
            return take()
        except Exception as error:  # of any kind, as without a display: play goes on
            if not self._failed:
                self._failed = True
                self._member.warn(f"no picture is shown: {error}")
            return None


def _shares(
    corners: NDArray[np.float32] | None, picture: NDArray[np.uint8] | None
) -> tuple[float, ...]:
    """Returns ``corners float32 [4, 2]`` as shares of the width and height of ``picture``.

    Whole numbers in ``corners`` are pixel centres.
    """
    if corners is None or picture is None:
        return ()
    height, width = picture.shape[:2]
    return tuple(((corners + 0.5) / (width, height)).ravel().tolist())


def _jpeg(picture: NDArray[np.uint8] | None) -> bytes:
    """Returns ``picture uint8 [rows, columns(, 3)]`` as a JPEG, no larger than a view allows."""
    if picture is None:
        return b""
    if (scale := MAX_SIDE / max(picture.shape[:2])) < 1:
        small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        picture = np.asarray(small, np.uint8)
    if picture.ndim == 3:
        picture = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)  # type: ignore[assignment]
    for quality in (85, 50, 10):
        _, encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
        if encoded.size <= MAX_PICTURE_BYTES:
            return encoded.tobytes()
    return b""

"""Records the steps of an environment, game by game, as a dataset."""

import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from actors.envs.game_env import GameEnv
from actors.envs.robot import RobotEnv
from actors.envs.shown_env import ShownEnv
from actors.loop import Step
from actors.stream.chunker import STEP_VALUES
from common.actions import Keys
from common.counted import counted
from common.dataset.layout import CAMERA, COLUMNS, MAX_EPISODE_STEPS, Feature, step_features
from common.errors import InputError, writing
from common.process.extras import extra_for
from common.proprioception import KEYS
from common.registry import ENVIRONMENTS, ROBOTS
from common.settings.config import RunConfig
from viewer.movie import Add, open_movie

_SAMPLE_EVERY = 30
"""Interval between the pictures that count in the statistics."""


_Seen = tuple[dict[str, NDArray[Any]], NDArray[np.uint8] | None]
"""Columns of a state other than the network's input, and the camera's picture, ``uint8 [rows,
columns, 3]``."""


def check_new_folder(folder: Path) -> None:
    """Raises InputError if ``folder``, which a recording should make, exists already."""
    if folder.exists():
        raise InputError(f"{folder} already exists: name a new folder.")


class Recorder(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose steps are recorded, each with what was seen when its action was chosen.

    `step` looks before it acts; the caller then hands the step to `add`. Columns stay in memory
    until their game ends; the video is written at once.
    """

    def __init__(self, env: ShownEnv[Any, Any], config: RunConfig, folder: Path) -> None:
        """Starts a recording. Raises InputError if ``folder`` exists already, it cannot be written,
        or pyarrow is missing."""
        with extra_for("a recording", "record"):
            from common.dataset.writer import DatasetWriter
        super().__init__(env)
        inner = env.unwrapped
        features = step_features(config.vector_width)
        if isinstance(inner, GameEnv):
            keys = Feature("bool", (len(KEYS),), [str(key.name).lower() for key in KEYS])
            features |= {"observation.keys": keys, "command": keys}
            picture = inner.seen
            features[CAMERA] = Feature("video", picture.shape, ["height", "width", "channels"])
        if isinstance(inner, RobotEnv):
            joints = ROBOTS.find(config.play.robot).joints
            features["observation.state"] = Feature("float32", (joints,))
        robot = config.play.robot if ENVIRONMENTS.find(config.env).robot else config.env
        check_new_folder(folder)
        with writing(folder):
            folder.mkdir(parents=True)
            try:
                self.dataset = DatasetWriter(folder, config, features, robot, env.rate)
            except OSError:
                shutil.rmtree(folder, ignore_errors=True)  # or the next try would be refused
                raise
        self._features = features
        self._rows: list[dict[str, Any]] = []
        self._sampled: list[NDArray[np.uint8]] = []
        self._film: Add
        self._filming = ExitStack()
        self._seen: _Seen = {}, None
        self._was_cut = self._is_too_long = False

    @property
    def steps(self) -> int:
        """Number of recorded steps, including those of the present game."""
        return self.dataset.steps + len(self._rows)

    @property
    def summary(self) -> str:
        """A line for people that sums up the closed recording."""
        dataset = self.dataset
        games, steps = counted(dataset.episodes, "game"), counted(dataset.steps, "step")
        cut = ", cut at the end," if self._was_cut else ""
        return f"wrote {games} of {steps}{cut} to {dataset.folder}"

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        self._seen = self._look()
        return self.env.step(action)

    def add(self, step: Step) -> None:
        """Records the step that was just played. The rest of a game that is longer than any that a
        reader takes (`MAX_EPISODE_STEPS`) is left out."""
        if self._is_too_long:
            self._is_too_long = not step.info.game_over
            return
        row = {COLUMNS[name]: value(step) for name, value in STEP_VALUES.items()}
        # The loop overwrites its states in place.
        row[COLUMNS["frames"]] = step.s_tm1[-1].copy()
        row[COLUMNS["vectors"]] = step.x_tm1.copy()
        inner = self.unwrapped
        if isinstance(inner, GameEnv):
            row["command"] = _flags(inner.wanted)
        columns, picture = self._seen
        if picture is not None:
            with self._writing():
                if not self._rows:
                    film = open_movie(self.dataset.video, self.dataset.rate)
                    self._film = self._filming.enter_context(film)
                self._film(picture)
            if len(self._rows) % _SAMPLE_EVERY == 0:
                self._sampled.append(picture)
        self._rows.append(row | columns)
        if step.info.game_over:
            self.cut()
        elif len(self._rows) == MAX_EPISODE_STEPS:
            self._is_too_long = True
            self.cut()

    def cut(self) -> None:
        """Ends the present game here; its last step is truncated, unless the game ended by itself.
        Raises InputError if the recording cannot be written."""
        rows, self._rows = self._rows, []
        sampled, self._sampled = self._sampled, []
        with self._writing():
            self._filming.close()
        if not rows:
            return
        last = rows[-1]
        last[COLUMNS["truncated"]] = not last[COLUMNS["terminated"]]
        columns = {
            name: np.array([row[name] for row in rows], feature.dtype)
            for name, feature in self._features.items()
            if feature.dtype != "video"
        }
        with self._writing():
            self.dataset.add(columns, sampled)

    def close(self) -> None:
        """Keeps the present game as far as it goes, and closes the environment; a recording without
        any game leaves nothing."""
        self._was_cut = bool(self._rows)
        try:
            self.cut()
        finally:
            if not self.dataset.episodes:
                shutil.rmtree(self.dataset.folder, ignore_errors=True)
            super().close()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Raises InputError where the recording cannot be written; the present game is lost."""
        try:
            yield
        except OSError as error:
            self._rows.clear()
            with suppress(OSError):  # the film of half a game is dropped
                self._filming.__exit__(type(error), error, error.__traceback__)
            whole = f"; the {self.dataset.episodes:,} games before are complete"
            raise InputError(
                f"{self.dataset.folder} cannot be written ({error.strerror}): make room, and "
                f"record into another folder{whole if self.dataset.episodes else ''}."
            ) from None

    def _look(self) -> _Seen:
        inner = self.unwrapped
        columns: dict[str, NDArray[Any]] = {}
        if not isinstance(inner, GameEnv):
            return columns, None
        columns["observation.keys"] = _flags(inner.pressed)
        if isinstance(inner, RobotEnv):
            with inner.still():
                columns["observation.state"] = inner.robot.proprioception()[0].astype(np.float32)
        return columns, inner.seen


def _flags(keys: Keys) -> NDArray[np.bool_]:
    return np.array([bool(keys & key) for key in KEYS])

"""Sends a game to Rerun: the room in 3-D, pictures, keys and figures, live or to a file.

Lengths are in m, angles in rad, and positions in the room's coordinates.
"""

import threading
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.envs.robot import RobotEnv
from actors.envs.shown_env import ShownEnv
from actors.loop import Step
from actors.robots.room.furniture import PICTURE_CORNERS
from actors.robots.room.room import Room
from actors.robots.room.scene import DrawnShape
from actors.robots.room.viewpoint import VISITOR
from actors.vision.field_of_view import HEIGHT_ANGLE, WIDTH_ANGLE
from actors.vision.layout import BORDER, border_of
from common.actions import KEYS_OF_ACTION, Keys
from common.atomic_file import check_new_file
from common.errors import InputError
from common.process.extras import extra_for
from common.proprioception import KEYS
from viewer import overlay
from viewer.rerun_viewer import RerunViewer

_QUALITY = 90
"""Quality of the JPEGs; an hour of raw pictures would not fit into the viewer's memory."""
_GAME = (320, 240)
"""Width and height of the game's picture, in a television's shape."""
_GAME_BORDER = tuple(round(BORDER * edge) for edge in _GAME)
_BEFORE_SCREEN = 0.01
"""Distance from the game's picture to the pinhole that shows it, m."""
_THIN = 1e-6
"""Width of that pinhole's lines, which should be invisible, m."""
_FRUSTUM = 0.12
"""Distance at which the camera's picture is drawn, m."""


class RerunStream:
    """Sends what an environment shows after each step. Raises InputError if Rerun is not installed,
    its viewer cannot be started here, or the file cannot be written.

    Args:
        live: whether to send to a viewer.
        save: file to record to; its name ends in .rrd.
    """

    def __init__(self, env: ShownEnv[Any, Any], *, live: bool, save: Path | None) -> None:
        if save is not None and save.suffix != ".rrd":
            raise InputError(f"{save} is not a recording's name: let it end in .rrd.")
        if save is not None:
            check_new_file(save)
        with extra_for("--viewer rerun or --save", "viz"):
            import rerun
        self._rerun: ModuleType = rerun
        self._env = env
        self._agent_steps = 0
        self._sent: dict[str, NDArray[np.float64]] = {}
        room = env.robot if isinstance(env, RobotEnv) and isinstance(env.robot, Room) else None
        self._scene = None if room is None else room.scene()
        self._game = "game" if room is None else "room/screen/game"
        self._q = [
            str(index) if action is None else _name_of(KEYS_OF_ACTION[action])
            for index, action in enumerate(env.actions)
        ]
        self._viewer = RerunViewer(rerun) if live else None
        self._stream = rerun.RecordingStream("ale-robot")
        self._log = self._stream.log
        self._stream.set_log_time_enabled(False)  # the game's time is enough
        sinks = ([rerun.GrpcSink()] if live else []) + ([rerun.FileSink(save)] if save else [])
        self._stream.set_sinks(*sinks)
        self._stream.send_blueprint(_blueprint(self._game, room=room is not None))
        names = {f"q/{name}": name.replace("_", " ") for name in self._q}
        names |= {"play/score": "score, points", "play/steps": "agent steps of the game"}
        if self._scene is not None:
            self._log_room(self._scene.shapes)
            names |= {f"joints/{name}": f"{name}, rad" for name in self._scene.joints()}
        for path, name in names.items():
            self._log(path, rerun.SeriesLines(names=name), static=True)
        lines = rerun.SeriesLines(names=list(map(_name_of, KEYS)), interpolation_mode="StepAfter")
        for kind in ("commanded", "pressed"):
            self._log(f"keys/{kind}", lines, static=True)

    def show(self, step: Step, values: NDArray[np.float32] | None) -> None:
        """Sends the state after ``step``, whose action was chosen by the Q-values ``values``."""
        env, rerun = self._env, self._rerun
        self._agent_steps += step.info.elapsed
        self._stream.set_time("agent step", sequence=self._agent_steps)
        self._stream.set_time("game time", duration=self._agent_steps / env.rate)
        if isinstance(env, RobotEnv):
            # The world stands still, or in real time it would move on from picture to picture.
            with env.still():
                self._show_robot(env)
        else:
            self._show_game(env.seen)
        self._picture("network/input", step.s_t[-1])
        if values is not None:
            for name, value in zip(self._q, values.tolist(), strict=True):
                self._log(f"q/{name}", rerun.Scalars(value))
        self._log("play/score", rerun.Scalars(step.info.game_score))
        self._log("play/steps", rerun.Scalars(step.info.game_steps))

    def linger(self, stop: threading.Event) -> None:
        """Keeps serving our own page, if there is one, until ``stop`` is set."""
        if self._viewer is not None:
            self._viewer.linger(stop)

    def close(self) -> None:
        """Completes the file, and ends the server of our own page."""
        self._stream.disconnect()
        if self._viewer is not None:
            self._viewer.close()

    def _log_room(self, shapes: dict[str, list[DrawnShape]]) -> None:
        rerun = self._rerun
        self._log("/", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for name, every in shapes.items():
            for kind in sorted({shape.kind for shape in every}):
                of_kind = [shape for shape in every if shape.kind == kind]
                self._log(f"{name}/{kind}", _drawn(rerun, kind, of_kind), static=True)
        # The projected picture is the image plane of a pinhole close in front of the screen.
        left_top, right_top, _, left_bottom = PICTURE_CORNERS
        right, down = right_top - left_top, left_bottom - left_top
        edges = np.linalg.norm([right, down], axis=1)
        place = rerun.Transform3D(
            translation=PICTURE_CORNERS.mean(axis=0) - (_BEFORE_SCREEN + 0.001, 0.0, 0.0),
            mat3x3=np.stack([right / edges[0], down / edges[1], (1.0, 0.0, 0.0)], axis=1),
        )
        size = np.array(_GAME) + 2 * np.array(_GAME_BORDER)
        eye = rerun.Pinhole(
            resolution=size,
            focal_length=_BEFORE_SCREEN * size / edges,
            image_plane_distance=_BEFORE_SCREEN,
            line_width=_THIN,
        )
        self._log(self._game, place, eye, static=True)

    def _show_robot(self, env: RobotEnv) -> None:
        rerun = self._rerun
        self._show_game(env.emulator.screen_rgb())
        if self._scene is not None:
            for name, pose in self._scene.poses().items():
                if self._is_new(name, pose):
                    place = rerun.Transform3D(translation=pose[:3], quaternion=pose[3:])
                    self._log(name, place)
            for name, angle in self._scene.joints().items():
                self._log(f"joints/{name}", rerun.Scalars(angle))
        self._show_camera(env)
        for kind, keys in (("commanded", env.wanted), ("pressed", env.pressed)):
            self._log(f"keys/{kind}", rerun.Scalars([float(key in keys) for key in KEYS]))

    def _show_game(self, screen: NDArray[np.uint8]) -> None:
        game = cv2.resize(screen, _GAME, interpolation=cv2.INTER_NEAREST)
        if self._scene is not None:  # with its border, as it is projected
            across, down = _GAME_BORDER
            game = cv2.copyMakeBorder(
                game, down, down, across, across, cv2.BORDER_CONSTANT, value=(0, 0, 0)
            )
        self._picture(self._game, np.asarray(game, np.uint8))

    def _show_camera(self, env: RobotEnv) -> None:
        rerun = self._rerun
        self._picture("robot/camera", env.seen)
        if isinstance(env.robot, Room):
            eye = env.robot.view_of_robot.camera
            if self._is_new("robot/camera", np.vstack((eye.position, eye.attitude))):
                place = rerun.Transform3D(translation=eye.position, mat3x3=eye.attitude)
                size = np.array(env.seen.shape[1::-1])
                focal = size / 2 / np.tan(np.radians([WIDTH_ANGLE, HEIGHT_ANGLE]) / 2)
                frustum = rerun.Pinhole(
                    resolution=size, focal_length=focal, image_plane_distance=_FRUSTUM
                )
                self._log("robot/camera", place, frustum)
        found = env.detection
        quads = [] if found.corners is None else [border_of(found.corners), found.corners]
        # In Rerun, pixels begin at whole coordinates; ours have their centres there.
        strips = [np.vstack((quad, quad[:1])) + np.float32(0.5) for quad in quads]
        colours = [overlay.YELLOW, overlay.MAGENTA] if found.valid else [overlay.RED] * 2
        outline = rerun.LineStrips2D(strips, colors=colours[: len(strips)])
        self._log("robot/camera/detection", outline)

    def _picture(self, path: str, pixels: NDArray[np.uint8]) -> None:
        self._log(path, self._rerun.Image(pixels).compress(jpeg_quality=_QUALITY))

    def _is_new(self, path: str, pose: NDArray[np.float64]) -> bool:
        """Returns whether ``pose`` differs from the one that was sent last."""
        if np.array_equal(self._sent.get(path, ()), pose):
            return False
        self._sent[path] = pose
        return True


def _drawn(rerun: ModuleType, kind: str, shapes: list[DrawnShape]) -> Any:
    """Returns shapes of one kind as Rerun draws them."""
    sizes = np.array([shape.size for shape in shapes])
    common = {
        "centers": [shape.origin for shape in shapes],
        "quaternions": [shape.turn for shape in shapes],
        "colors": np.array([shape.colour for shape in shapes]),
        "fill_mode": "solid",
    }
    if kind == "box":
        return rerun.Boxes3D(sizes=sizes, **common)
    if kind == "rod":
        return rerun.Cylinders3D(lengths=sizes[:, 0], radii=sizes[:, 1], **common)
    return rerun.Ellipsoids3D(half_sizes=sizes, **common)


def _blueprint(game: str, *, room: bool) -> Any:
    """Returns the arrangement of the views; ``game`` is the entity of the game's picture."""
    import rerun.blueprint as rrb

    pictures = [
        rrb.Spatial2DView(origin="robot/camera", name="Robot's camera"),
        rrb.Spatial2DView(origin="network/input", name="Network's input"),
        rrb.Spatial2DView(origin=game, name="Game"),
    ]
    eye = rrb.EyeControls3D(position=VISITOR.position, look_target=VISITOR.target)
    scene = rrb.Spatial3DView(
        contents=["room/**", "robot/**", "controller/**"], name="Room, m", eye_controls=eye
    )
    figures = [
        rrb.TimeSeriesView(origin=origin, name=name)
        for origin, name in (
            ("q", "Q-values, points"),
            ("play/score", "Score, points"),
            ("keys/commanded", "Keys commanded, 1: down"),
            ("keys/pressed", "Keys pressed, 1: down"),
            ("joints", "Joints, rad"),
        )
    ]
    left = rrb.Vertical(scene, rrb.Horizontal(*pictures), row_shares=[2, 1]) if room else None
    return rrb.Blueprint(
        rrb.Horizontal(left or rrb.Vertical(*pictures), rrb.Vertical(*figures)),
        rrb.TimePanel(timeline="game time", state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )


def _name_of(keys: Keys) -> str:
    return "_".join(str(key.name).lower() for key in keys) or "noop"

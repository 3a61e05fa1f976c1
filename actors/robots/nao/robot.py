"""NAO on a chair at a desk with the controller, in front of the projection screen."""

from pathlib import Path

from actors.robots.nao.arms import Arms
from actors.robots.nao.chair import CHAIR
from actors.robots.nao.controller import Controller
from actors.robots.nao.eye import TOP_CAMERA
from actors.robots.nao.posture import TORSO_ORIGIN
from actors.robots.nao.urdf import write_urdf
from actors.robots.room.engine import angles_of
from actors.robots.room.furniture import DESK_TOP
from actors.robots.room.room import Room
from actors.robots.room.viewpoint import VISITOR, Viewpoint


class Nao(Room):
    """NAO presses the controller's keys with its fingertips and sees by the camera in its
    forehead."""

    mount = TOP_CAMERA
    viewpoints = {  # noqa: RUF012
        "room": VISITOR,
        "hands": Viewpoint((0.46, -0.12, 0.46), (0.185, 0.0, 0.222), 30.0),
        "front": Viewpoint((0.66, -0.32, 0.72), (0.075, 0.0, 0.272), 34.0),
    }
    own_furniture = CHAIR
    arms: Arms
    controller: Controller

    def _build(self, folder: Path) -> None:
        engine = self._engine
        self.body: int = engine.loadURDF(
            str(write_urdf(folder)),
            TORSO_ORIGIN,
            useFixedBase=True,
            flags=engine.URDF_USE_INERTIA_FROM_FILE,
        )
        for link in range(engine.getNumJoints(self.body)):
            engine.changeDynamics(self.body, link, linearDamping=0.0, angularDamping=0.0)
        self.controller = Controller(engine, folder, DESK_TOP)
        self.arms = Arms(engine, self.body, self.controller)

    def angles(self) -> dict[str, float]:
        """Returns the angle of each moving joint, rad, by joint name."""
        return angles_of(self._engine, self.body)

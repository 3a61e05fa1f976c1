"""A robot with NAO's eye, resting arms, and a latency model in place of its hands."""

from numpy.random import Generator

from actors.robots.latency_model.model import LatencyModel
from actors.robots.nao.robot import Nao
from common.actions import Keys
from common.settings.conditions import CameraConfig, Conditions, PlayConfig


class ModelledNao(Nao):
    """NAO in its room, except that the keys follow the latency model in the file ``play.robot``.

    It sees what NAO sees. A frame passes without physics and no finger moves, so proprioception
    always gives joints at rest, as with ``play.hand`` "model".
    """

    def __init__(
        self, screen_shape: tuple[int, int], camera: CameraConfig, play: PlayConfig
    ) -> None:
        """Raises InputError if the file holds no latency model."""
        self._model = LatencyModel.of_play(play)
        super().__init__(screen_shape, camera, play)

    @property
    def held(self) -> Keys:
        return self._model.held

    def begin_game(self, conditions: Conditions, rng: Generator) -> None:
        super().begin_game(conditions, rng)
        self._model.take_copy(conditions.copy)

    def rest(self) -> None:
        super().rest()
        self._model.rest()

    def command(self, keys: Keys) -> None:
        self._model.command(keys)

    def step_frame(self) -> Keys:
        return self._model.step_frame()

"""Environments, robots, algorithms and samplers, by the names that a run's configuration uses.

Learner and replay need only an environment's number of actions and the width of its vector
observation; actors load the rest. Actors need only the network of an algorithm. So an entry holds
what all processes need, and names its factory as text that is resolved late: PyBullet, OpenCV,
ale-py and the learner are loaded only where they are used.

To add an environment, write one module and an entry for it. The entry is added by
`ENVIRONMENTS.add` in the same process, or by an entry point of an installed package, which every
process of a run finds (CONTRIBUTING.md)::

    [project.entry-points."ale_robot.environments"]
    catch = "my_package:CATCH"
"""

import pkgutil
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from common.actions import KEYS_OF_ACTION
from common.errors import InputError, choice
from common.games import MINIMAL_ACTIONS, check_game
from common.pinned_file import path_of
from common.proprioception import vector_width
from common.settings.conditions import OF_A_ROBOT, LatencyModelSettings, PlayConfig, marked

if TYPE_CHECKING:
    from common.settings.config import LearningConfig, PresetName, RunConfig


@dataclass(frozen=True)
class Entry:
    """What is known of a thing without loading it."""

    name: str
    factory: str | Callable[..., Any]
    """The callable that makes it, or its place as ``"module:factory"``."""
    settings: type | None = field(default=None, kw_only=True)
    """Dataclass of the settings that it declares for itself (`common.settings.own_settings`)."""


@dataclass(frozen=True)
class Environment(Entry):
    """An environment: ``factory(config: RunConfig, clock: ClockConfig, *, training: bool)`` returns
    the `gymnasium.Env`. With ``training``, episodes may end at a lost life."""

    actions: Callable[["RunConfig"], int]
    """Returns the number of actions. Raises InputError for an unknown game."""
    vector_width: Callable[[PlayConfig], int] = lambda play: vector_width(play, 0)
    """Returns the width of the vector observation, for ``play.vector``."""
    robot: bool = False
    """Whether hands press the keys, so that real time and waiting for keys have a meaning."""
    preset: "PresetName" = "fast"
    """Preset that is used if none is named."""
    ignores: tuple[str, ...] = ()
    """Settings, such as ``camera.yaw``, that have no effect in it; changing them, or ranges around
    them, is refused."""
    title: str = ""
    atari: bool = False
    """Whether it plays the Atari game that the settings name."""


@dataclass(frozen=True)
class RobotKind(Entry):
    """A robot: ``factory(screen_shape: tuple[int, int], camera: CameraConfig, play: PlayConfig)``
    returns the `actors.robots.interface.Robot`."""

    joints: int
    """Number of joints of its arms, whose angles and speeds are in the vector observation."""
    prompt: bool = True
    """Whether hands that work hold the commanded keys before the agent step ends."""


@dataclass(frozen=True)
class AlgorithmKind(Entry):
    """An algorithm: ``factory(network, config: LearningConfig, device: learner.device.Device,
    seed: int)`` returns the `learner.algorithm.interface.Algorithm`."""

    network: str | Callable[..., Any] = "common.network:QNetwork"
    """Class of its network, a `common.network.QNetwork`; or ``"module:class"``."""
    atoms: Callable[["LearningConfig"], int] = lambda learning: 1
    """Returns the number of outputs per action; `QNetwork` takes their mean as the value."""
    ignores: tuple[str, ...] = ()
    """Fields of `LearningConfig` that have no effect with it."""


@dataclass(frozen=True)
class SamplerKind(Entry):
    """A sampler: ``factory(capacity: int, ids: NDArray[np.int64], leaves: NDArray[np.float64],
    config: ReplayConfig)`` returns the `replay.samplers.UniformSampler`, or one of a subclass, that
    draws from ``ids``."""

    prioritised: bool = False
    """Whether the learner tells it the priorities of what it drew. ``leaves``, otherwise empty, is
    then a number for each slot, which outlives the process."""
    ignores: tuple[str, ...] = ()
    """Fields of `ReplayConfig` that have no effect with it."""


def resolve(factory: str | Callable[..., Any]) -> Callable[..., Any]:
    """Returns what ``"module:name"`` stands for, and loads the module; a callable as it is."""
    found: Callable[..., Any] = (
        pkgutil.resolve_name(factory) if isinstance(factory, str) else factory
    )
    return found


@contextmanager
def foreign(what: str) -> Iterator[None]:
    """Raises InputError, with error and place, if the block fails, in which ``what`` works: code of
    another package."""
    try:
        yield
    except (InputError, OSError):
        raise
    except Exception as error:  # of any kind, as the package is not ours
        raise InputError(failure(what, error)) from error


def failure(what: str, error: Exception) -> str:
    """Returns the sentence that ``what``, code of another package, failed by ``error``."""
    return f"{what} fails ({placed(error)}): mend its package."


def placed(error: Exception) -> str:
    """Returns a raised ``error`` of another package, and the line that raised it."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{error!r}, {place.filename}:{place.lineno}"


T = TypeVar("T", bound=Entry)


class Registry(Generic[T]):
    """Entries by name: this project's, added ones, and those of installed packages.

    An entry called FILE.npz stands for every path with that ending, with or without a hash (see
    `common.pinned_file`).
    """

    def __init__(self, noun: str, *entries: T) -> None:
        self._noun = noun
        self._group = f"ale_robot.{noun}s"
        self._ours = entries
        self._entries = {entry.name: entry for entry in entries}

    @property
    def names(self) -> list[str]:
        """All names, sorted; installed packages are not loaded to find theirs."""
        return sorted({*self._entries, *entry_points(group=self._group).names})

    def add(self, entry: T) -> None:
        """Adds ``entry``, or replaces the entry of the same name."""
        self._entries[entry.name] = entry

    def called(self, name: str) -> str:
        """Returns the name of the entry that ``name`` stands for: FILE.npz for each such path."""
        file = f"FILE{path_of(name).suffix}"
        return file if file in self._entries and name not in self._entries else name

    def find(self, name: str) -> T:
        """Returns the entry called ``name``. Raises InputError if there is none, or if several
        packages have one, or if the package that has it cannot be loaded."""
        if name not in self._entries:
            points = {each.value: each for each in entry_points(group=self._group, name=name)}
            if len(points) > 1:
                raise InputError(
                    f"several installed packages have the {self._noun} {name!r} "
                    f"({', '.join(sorted(points))}): uninstall all but one."
                )
            for point in points.values():
                self.add(self._load(point))
        key = self.called(name)
        if key not in self._entries:
            hint = choice(name, self.names)
            hint = f"{hint[:-1]}, or" if hint.endswith(".") else f"{hint} Otherwise"
            raise InputError(
                f"there is no {self._noun} {name!r}: {hint} install the package that has it."
            )
        return self._entries[key]

    def _load(self, point: EntryPoint) -> T:
        what = f"the {self._noun} {point.name!r} of an installed package, {point.value},"
        try:
            entry: T = point.load()
        except Exception as error:  # of any kind, as the package is not ours
            raise InputError(
                f"{what} cannot be loaded ({error!r}): mend the package, or uninstall it."
            ) from error
        if getattr(entry, "name", None) != point.name:
            raise InputError(f"{what} is not an entry of that name: mend the package.")
        return entry

    def make(self, name: str, *arguments: Any, **named: Any) -> Any:
        """Returns what the factory of ``name`` makes of the other arguments. Raises InputError if
        there is no such entry, or if the factory of another package fails."""
        entry = self.find(name)
        if entry in self._ours:  # a traceback tells us more about our own mistakes
            return resolve(entry.factory)(*arguments, **named)
        with foreign(f"the factory of the {self._noun} {name!r}"):
            return resolve(entry.factory)(*arguments, **named)


def _atari_actions(config: "RunConfig") -> int:
    minimal = MINIMAL_ACTIONS[check_game(config.game)]
    return len(minimal if config.play.minimal_actions else KEYS_OF_ACTION)


ROBOTS = Registry(
    "robot",
    RobotKind("nao", "actors.robots.nao.robot:Nao", joints=8),
    RobotKind("robotroller", "actors.robots.robotroller.robot:Robotroller", joints=3),
    RobotKind(
        "FILE.npz",
        "actors.robots.latency_model.robot:ModelledNao",
        joints=8,
        prompt=False,
        settings=LatencyModelSettings,
    ),
)

ALGORITHMS = Registry(
    "algorithm",
    AlgorithmKind("dqn", "learner.algorithm.double_dqn:double_dqn", ignores=("quantiles",)),
    AlgorithmKind(
        "qr_dqn",
        "learner.algorithm.qr_dqn:qr_dqn",
        atoms=lambda learning: learning.quantiles,
        ignores=("loss", "loss_mean_over"),
    ),
)

SAMPLERS = Registry(
    "sampler",
    SamplerKind(
        "uniform",
        "replay.samplers:UniformSampler.of_run",
        ignores=("priority_exponent", "importance_exponent"),
    ),
    SamplerKind("prioritised", "replay.samplers:PrioritisedSampler.of_run", prioritised=True),
)

ENVIRONMENTS = Registry(
    "environment",
    Environment(
        "ale",
        "actors.envs.ale:AtariEnv.of_run",
        _atari_actions,
        ignores=marked(OF_A_ROBOT),
        title="ALE-Only",
        atari=True,
    ),
    Environment(
        "robot",
        "actors.envs.robot:RobotEnv.of_run",
        _atari_actions,
        lambda play: vector_width(play, ROBOTS.find(play.robot).joints),
        robot=True,
        preset="robot",
        title="ALE-Robot",
        atari=True,
    ),
)

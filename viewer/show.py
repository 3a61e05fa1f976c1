"""`python -m actors --play`: games played for show, recorded or streamed as panels."""

import threading
from contextlib import ExitStack

import numpy as np

from actors.envs import make_env
from actors.envs.ale import AtariEnv
from actors.envs.robot import RobotEnv
from actors.loop import play
from actors.viewer_options import ViewerOptions
from common.run.clock import ClockConfig
from common.run.config import RunConfig
from viewer.movie import Movie, open_movie
from viewer.observer import Observer
from viewer.panels import draw_panels
from viewer.player import ShownPolicy
from viewer.rerun_stream import RerunStream

OUTSIDE_EVERY = 4
"""Agent steps between renderings of the whole room: it is seen from afar."""


def show(
    options: ViewerOptions,
    config: RunConfig,
    clock: ClockConfig,
    *,
    seed: int,
    stop: threading.Event,
) -> int:
    """Play ``options.games`` games, or ``options.seconds``, or until ``stop``; the exit status.

    Raises:
        InputError: weights, film, viewer or the user's robot cannot be used.
    """
    with ExitStack() as stack:
        viewer = RerunStream() if options.viewer == "rerun" else None
        env = make_env(config, clock, training=False)
        stack.callback(env.close)
        assert isinstance(env, (RobotEnv, AtariEnv))
        policy_seed, env_seed = map(int, np.random.SeedSequence(seed).generate_state(2))
        actions = int(env.action_space.n)  # type: ignore[attr-defined]
        policy = ShownPolicy.of_file(config, actions, options.weights, options.epsilon, policy_seed)
        movie: Movie | None = None
        if options.video is not None:
            rate = 60 / config.play.frame_skip
            movie = stack.enter_context(open_movie(options.video, rate))
        observer = Observer(env, config.play, options.nao_urdf, outside_every=OUTSIDE_EVERY)
        stack.callback(observer.close)
        scores: list[float] = []
        missed = 0
        # Agent steps that are still to be shown.
        left = options.seconds * 60 / config.play.frame_skip or float("inf")
        for step in play([env], policy, [env_seed]):
            if movie is not None or viewer is not None:
                snapshot = observer.look(step, policy.values)
                panels = draw_panels(snapshot)
                if movie is not None:
                    # A step that took longer is seen for longer.
                    for _ in range(step.info.elapsed):
                        movie.add(panels)
                if viewer is not None:
                    viewer.show(snapshot, panels)
            missed += step.info.missed_deadlines
            if step.info.game_over:
                scores.append(step.info.game_score)
                # Taking pictures takes time, and a world that goes on by itself does not wait.
                late = "" if clock.sync else f", {missed} deadlines missed"
                print(
                    f"game {len(scores)}: score {scores[-1]:g} "
                    f"in {step.info.game_steps} steps{late}",
                    flush=True,
                )
                missed = 0
            left -= step.info.elapsed
            if len(scores) == options.games or left <= 0 or stop.is_set():
                break
    if len(scores) > 1:
        print(f"mean score of {len(scores)} games: {np.mean(scores):.2f}")
    if options.video is not None:
        print(f"wrote {options.video}")
    return 0

"""The presets, with a reason for each value.

`paper` has the 2017 settings (R. Vargas, "Atari-playing Robot",
https://github.com/renattou/ALE-Robot), `fast` learns ALE-Only sooner, `robot` is for the robot, and
`frugal` spares its agent steps.
`paper` differs from the code of 2017 in two respects: a game is truncated after 30 minutes, and the
actors play the random steps before learning starts like all other steps.
"""

from dataclasses import replace

from common.settings.conditions import PlayConfig
from common.settings.config import (
    ExplorationConfig,
    LearningConfig,
    PresetName,
    ProtocolConfig,
    ReplayConfig,
    RunConfig,
)

_PAPER = RunConfig(
    preset="paper",
    env="ale",
    play=PlayConfig(
        minimal_actions=True,  # 2017, section 4: Pong's own 6
        read_keys="decision",  # before the arms move, as in the code of 2017
    ),
    replay=ReplayConfig(
        capacity=1_000_000,  # 2017, table of settings; Mnih et al. 2015
        learning_starts=50_000,  # the code of 2017
    ),
    learning=LearningConfig(
        target="double",  # 2017, equation 4
        loss="mse",  # 2017, equation 2
        loss_mean_over="outputs",  # Keras' mean, in the code of 2017
        optimizer="rmsprop",  # 2017, with the settings of Mnih et al. 2015
        learning_rate=2.5e-4,
        rmsprop_decay=0.95,
        optimizer_epsilon=0.01,
        gradient_norm=0.0,  # unbounded in 2017
        initial_weights="glorot",  # Keras' default
        scale_pixels=False,  # the code of 2017 fed 0 to 255
        n_step=1,  # 2017, equation 2
        target_update_period=2_500,  # 10,000 agent steps at one update per 4
    ),
    exploration=ExplorationConfig(start=1.0, end=0.1, steps=1_000_000),  # Mnih et al. 2015
    protocol=ProtocolConfig(epoch_steps=250_000, test_steps=125_000),  # 2017
)

_FAST = RunConfig(
    preset="fast",
    env="ale",
    play=PlayConfig(minimal_actions=True),  # fewer actions are explored sooner
    replay=ReplayConfig(
        # Much worse policies played older steps: with 200,000, one seed forgot again what it had
        # learned (LOG.md). Rainbow has a million.
        capacity=60_000,
        learning_starts=10_000,  # some ten games; 50,000 are a twentieth of a run of a million
    ),
    learning=LearningConfig(
        algorithm="qr_dqn",  # Dabney et al. 2018; with the mean return alone, learning begins later
        target="double",  # van Hasselt et al. 2016
        early_choice=True,  # a tenth more steps per second without a body (LOG.md)
        loss="huber",  # as the loss of quantiles, if another algorithm is chosen
        loss_mean_over="batch",
        optimizer="adam",  # Hessel et al. 2018 (Rainbow)
        learning_rate=5e-4,  # a constant rate wins half of the points, and soon no more (LOG.md)
        # A slower fall stands still at half of the height; 2.5e-5 would be slow for a longer run.
        annealing_steps=140_000,
        final_learning_rate=5e-5,
        weights_average=0.999,  # some 16,000 agent steps; learns sooner (LOG.md)
        optimizer_epsilon=1.5e-4,  # Rainbow's
        gradient_norm=10.0,  # Wang et al. 2016
        # Errors that reach the first layers whole, from what moves: learning begins 50,000 agent
        # steps sooner (LOG.md).
        initial_weights="he",
        layer_norm=True,
        frame_differences=True,
        scale_pixels=True,  # inputs near 1 suit the layers' initial weights
        center_pixels=True,  # else the background's grey silences units of the first layers
        # A point is lost some 50 agent steps after its cause. With each copy of the target network,
        # the loss is known n agent steps earlier. Rainbow has n = 3, and copies half as often.
        n_step=5,
        # The same samples per agent step as 32 every 4 (Mnih et al. 2015), in less time.
        batch_size=128,
        train_period=16,
        target_update_period=250,  # updates: 4,000 agent steps
        publish_period=12,  # updates: 192 agent steps
        checkpoint_period=1_250,  # updates: 20,000 agent steps
    ),
    exploration=ExplorationConfig(
        start=1.0,
        end=0.02,  # a rally lasts some 40 agent steps; at 0.1 four of them would be random
        steps=50_000,
        # εz-greedy (Dabney et al. 2021) learns sooner without the layers above, and later with
        # them (LOG.md).
        ez_greedy=False,
    ),
    protocol=ProtocolConfig(
        epoch_steps=50_000,  # a fifth of 2017's
        test_steps=10_000,  # about five whole games; in 2017 a test was half as long as training
    ),
)

_ROBOT = replace(
    _FAST,
    preset="robot",
    env="robot",
    # Minimal actions as in fast; other keys would move the hands without effect. No vector: without
    # it, two runs had 18 points after 501,000 and 551,000 steps; with it, one run had 18 points
    # after 651,000, and another was behind all of them at 200,000 (benchmarks/RESULTS.md).
    play=PlayConfig(minimal_actions=True),
    learning=replace(
        _FAST.learning,
        # Half as many samples per agent step as in fast, in four times as many updates: as good
        # after 400,000 steps, and at 18 points by 260,000 in three runs of nine; with 128 every
        # 16 after 355,000 or more. The robot's body leaves time for them, the emulator alone does
        # not (LOG.md).
        batch_size=16,
        train_period=4,
        learning_rate=2.5e-4,  # shorter steps, since there are four times as many
        annealing_steps=200_000,
        target_update_period=500,  # updates: 2,000 agent steps, so what is learned spreads sooner
        publish_period=48,  # updates: 192 agent steps
        checkpoint_period=5_000,  # updates: 20,000 agent steps
        # n = 5 also covers the latency from a command to its effect in the camera picture.
    ),
    exploration=replace(_FAST.exploration, steps=30_000),
)

_FRUGAL = replace(
    _ROBOT,
    preset="frugal",
    replay=replace(_ROBOT.replay, learning_starts=2_000),  # a fiftieth of a run of 100,000
    learning=replace(
        _ROBOT.learning,
        # An update at each step. Of 16 samples it is better than of 32 or 64, and those than 128 at
        # every fourth, which are as many as 32 (LOG.md; Obando-Ceron et al. 2023).
        train_period=1,
        annealing_steps=90_000,  # nearly all of a run of 100,000
        publish_period=192,  # as often by agent steps as in robot
        checkpoint_period=20_000,
    ),
    exploration=replace(_ROBOT.exploration, steps=10_000),
    protocol=replace(_ROBOT.protocol, epoch_steps=25_000),  # more points of a short curve
)

PRESETS: dict[PresetName, RunConfig] = {
    "paper": _PAPER,
    "fast": _FAST,
    "robot": _ROBOT,
    "frugal": _FRUGAL,
}

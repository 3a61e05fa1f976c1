"""The three presets: the report's settings, a fast ALE-Only, and the robot's.

Where `paper` differs from the 2017 code: a game is cut after 30 minutes, and the random steps that
fill the replay first are played by the actors like all others.
"""

from dataclasses import replace

from common.config import (
    ExplorationConfig,
    LearningConfig,
    PlayConfig,
    PresetName,
    ProtocolConfig,
    ReplayConfig,
    RunConfig,
)

_PAPER = RunConfig(
    preset="paper",
    env="ale",
    play=PlayConfig(minimal_actions=True, read_keys="decision"),
    replay=ReplayConfig(capacity=1_000_000, warmup=50_000),
    learning=LearningConfig(
        target="double",
        loss="mse",
        loss_mean_over="outputs",
        optimizer="rmsprop",
        learning_rate=2.5e-4,
        rmsprop_decay=0.95,
        optimizer_epsilon=0.01,
        gradient_norm=0.0,
        initial_weights="glorot",
        scale_pixels=False,
        n_step=1,
        target_every=2_500,  # 10,000 agent steps at one update per 4
    ),
    exploration=ExplorationConfig(start=1.0, end=0.1, steps=1_000_000),
    protocol=ProtocolConfig(epoch_steps=250_000, test_steps=125_000),
)

_FAST = RunConfig(
    preset="fast",
    env="ale",
    play=PlayConfig(minimal_actions=True),
    replay=ReplayConfig(capacity=200_000, warmup=10_000),
    learning=LearningConfig(),
    exploration=ExplorationConfig(start=1.0, end=0.02, steps=100_000),
    protocol=ProtocolConfig(epoch_steps=25_000, test_steps=12_500),
)

_ROBOT = replace(
    _FAST,
    preset="robot",
    env="robot",
    play=PlayConfig(minimal_actions=False),
    replay=ReplayConfig(capacity=300_000, warmup=10_000),
    learning=replace(_FAST.learning, n_step=5),
)

PRESETS: dict[PresetName, RunConfig] = {"paper": _PAPER, "fast": _FAST, "robot": _ROBOT}

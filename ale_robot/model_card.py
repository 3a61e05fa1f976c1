"""The model card of a policy: a README.md for people, with the metadata that a model hub reads."""

from collections.abc import Mapping, Sequence
from typing import Any

from ale_robot.environments import env_id
from ale_robot.policies import GridScores, evaluation_rows
from common.minus import minus_signed
from common.pinned_file import path_of
from common.press_latency import ms_of
from common.process.extras import extra_for
from common.registry import ENVIRONMENTS
from common.settings.config import RunConfig

_TEXT = """
# {name}: {game} by {how}

A network of ALE-Robot, a simulated robot that learns Atari games. It sees {input},
and chooses among {actions}. It was {trained} for {steps:,} agent steps of {milliseconds:.1f} ms.

| ε | sticky actions | mean score | games |
| --- | --- | --- | --- |
{rows}

Sticky actions: the probability that the console repeats the action of the frame before.
{grid}
    pip install 'ale-robot[hub]'
    ale-robot policies pull {repository}
    ale-robot watch {name}.safetensors

In Python, `ale_robot.load_policy("{name}.safetensors")` has `make_env`, `act` and `q_values`.

The weights have the SHA-256 `{sha256}`.
`{name}.json` has all settings of the training, and the score of each game.
The network was trained for this game, this robot and these settings. Before using it with others,
such as another latency or camera, evaluate it there
(`ale-robot evaluate {name}.safetensors --camera.noise 8`).
"""


def _begun(initial: object) -> str:
    """Returns how the training began, by the card's word for the network that it began with."""
    if not initial:
        return "trained"
    named = path_of(initial) if isinstance(initial, str) else "another network"
    return f"fine-tuned from {named}"


def model_card(name: str, card: Mapping[str, Any], config: RunConfig, repository: str) -> str:
    """Returns the text of README.md.

    Args:
        card: the card, as `learner.publish` writes it.
        config: the settings in the card.

    Raises:
        InputError: huggingface_hub is not installed.
    """
    play, env = config.play, ENVIRONMENTS.find(config.env)
    felt = "commands, keys and joints" if env.robot and play.vector_joints else "commands and keys"
    identity = env_id(config.game, robot=env.robot) if env.atari else env.name
    rows = [
        (row["epsilon"], row["sticky"], f"{row['mean']:.2f} ± {row['deviation']:.2f}", row["games"])
        for row in evaluation_rows(card)
    ]
    text = _TEXT.format(
        name=name,
        game=config.task.replace("_", " ").title(),
        how="a robot's camera and hands" if env.robot else "its own frames, without a body",
        input=f"the last {play.frame_stack} frames of 84×84 pixels"
        + (f", its {felt}" if play.vector else ""),
        actions="the game's own actions" if play.minimal_actions else "all 18 actions",
        trained=_begun(card.get("initial"))
        + (f" from {steps:,} recorded steps and" if (steps := card.get("demonstrations")) else ""),
        steps=card["agent_steps"],
        milliseconds=ms_of(play.frame_skip),
        rows="\n".join(f"| {e:g} | {s:g} | {score} | {games} |" for e, s, score, games in rows),
        grid="" if (grid := GridScores.of(card)) is None else _grid_text(grid),
        repository=repository,
        sha256=card["sha256"],
    )
    return f"---\n{_metadata(name, identity, rows)}\n---\n{text}"


def _metadata(name: str, identity: str, rows: Sequence[tuple[float, float, str, int]]) -> str:
    """Returns what a model hub reads, as YAML.

    Args:
        identity: what is played.
        rows: share of random actions, probability of sticky ones, score and number of games, for
            each evaluation.
    """
    with extra_for("a model hub", "hub"):
        from huggingface_hub import EvalResult, ModelCardData
    results = [
        EvalResult(
            task_type="reinforcement-learning",
            task_name="reinforcement learning",
            dataset_type=identity,
            dataset_name=f"{identity}, ε = {epsilon:g}, sticky {sticky:g}",
            metric_type="mean_reward",
            metric_name="mean score",
            metric_value=score.replace("±", "+/-"),
        )
        for epsilon, sticky, score, _ in rows
    ]
    topics = ["reinforcement-learning", "deep-reinforcement-learning", "atari", "robotics"]
    about = ModelCardData(
        library_name="ale-robot",
        license="mit",
        pipeline_tag="reinforcement-learning",
        tags=[*topics, identity],
        model_name=name,
        eval_results=results,
    )
    yaml: str = about.to_yaml()
    return yaml


def _grid_text(grid: GridScores) -> str:
    """Returns the paragraph on the grid of worlds."""
    mean, worst = (minus_signed(f"{score:.2f}") for score in (grid.mean, grid.worst))
    return (
        f"\nIn {grid.worlds} other worlds, with {grid.games} games each, its mean score is {mean}, "
        f"and {worst} in the worst:\nhands up to {grid.added_ms:.0f} ms later, noise and blur, "
        "other light, other poses, or late pictures.\n"
    )

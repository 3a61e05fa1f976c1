"""The published policies play as their cards say, from a clone alone."""

import hashlib
import json
from pathlib import Path

import pytest

from tests.end_to_end.conftest import Stage
from tests.paths import ROOT

GAMES = 5
MAX_WORSE = 3.0
"""Points by which the mean of so few games may fall short of the card's mean, or twice the
deviation of its games if that is more. It bounds luck, not skill: both are the mean of games of the
same network."""
MAX_BYTES = 4 * 2**20
"""Networks with a head of 51 quantiles have 4.04 million bytes."""
CARDS = pytest.mark.parametrize(
    "card", sorted((ROOT / "policies").glob("*.json")), ids=lambda card: card.stem
)


@CARDS
def test_a_card_tells_the_hash_and_the_bound_of_its_weights(card: Path) -> None:
    weights = card.with_suffix(".safetensors").read_bytes()
    assert json.loads(card.read_text())["sha256"] == hashlib.sha256(weights).hexdigest()
    assert len(weights) <= MAX_BYTES


@pytest.mark.slow
@CARDS
def test_a_published_policy_plays_as_its_card_says(stage: Stage, card: Path) -> None:
    evaluation = json.loads(card.read_text())["evaluation"]
    told, *_ = evaluation.get("rows", [evaluation])  # a former card has one
    weights = card.with_suffix(".safetensors")
    stage.start(
        *("-m", "learner.evaluation", str(weights), "--games", str(GAMES), "--seed", "77"),
        *("--epsilon", str(told["epsilon"]), "--play.sticky", str(told.get("sticky", 0.0))),
        *("--json", "found.json"),
    ).ends()
    found = json.loads((stage.folder / "found.json").read_text())
    assert len(found["scores"]) == GAMES
    assert found["mean"] >= told["mean"] - max(MAX_WORSE, 2 * told["deviation"])

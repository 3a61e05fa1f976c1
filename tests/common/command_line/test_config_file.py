"""Settings of a file: above the preset, below the flags."""

from dataclasses import replace
from pathlib import Path

import pytest

from common.errors import InputError
from common.settings.presets import PRESETS
from common.settings.stored_config import to_json
from tests.common.command_line.test_parser import Options, parsed


def test_settings_of_a_file_go_over_the_preset_and_below_the_flags(tmp_path: Path) -> None:
    file = tmp_path / "run.toml"
    file.write_text(
        'env = "ale"\nrun = "x"\n[play]\nminimal_actions = false\n[learning]\nn-step = 1'
    )
    options = parsed("--config", str(file), "--learning.n-step", "2")
    fast = PRESETS["fast"]
    expected = replace(
        fast,
        play=replace(fast.play, minimal_actions=False),
        learning=replace(fast.learning, n_step=2),
    )
    assert options == Options(expected, run="x")


def test_settings_of_a_stored_run_or_a_card_are_taken_whole(tmp_path: Path) -> None:
    stored = replace(PRESETS["paper"], game="breakout", seed=7)
    file = tmp_path / "config.json"
    file.write_text(to_json(stored))
    assert parsed(f"--config={file}").config == stored
    assert parsed("--seed", "8", "--config", str(file)).config == replace(stored, seed=8)
    card = tmp_path / "card.json"
    card.write_text(f'{{"run": "r", "config": {to_json(stored)}}}')
    assert parsed("--config", str(card)).config == stored
    for text in ("--version", "--config=x", "two words"):
        own = replace(stored, learning=replace(stored.learning, algorithm_settings=text))
        file.write_text(to_json(own))
        with pytest.raises(InputError, match=f"^--learning.algorithm-settings is '{text}'"):
            parsed("--config", str(file))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("run.toml", "seed = ", r"run\.toml cannot be read \("),
        ("run.toml", "config = 'b.toml'", "remove config from it"),
        ("run.toml", "sede = 3", "there is no flag --sede: did you mean"),
        ("run.toml", "seed = 0x" + "F" * 5_000, r"run\.toml cannot be read \(Exceeds"),
        ("run.toml", f"[{'a.' * 50_000}a]\nb = 1", r"cannot be read \(maximum recursion"),
        ("run.toml", "x = " + "[" * 50_000, r"cannot be read \(maximum recursion"),
        ("run.toml", r'runs = "\u0000"', "holds a NUL character: remove it"),
        ("config.json", "[]", "should be a table"),
        ("config.json", '{"a": 1}', r"cannot be read \(it holds no settings of a run\): mend"),
        ("config.json", "[" * 100_000, r"cannot be read \(maximum recursion"),
        ("none.toml", None, r"^there is no .*none.toml: name another file\."),
    ],
)
def test_a_file_of_settings_that_cannot_be_used_is_told(
    tmp_path: Path, name: str, content: str | None, words: str
) -> None:
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=words):
        parsed("--config", str(tmp_path / name))
    with pytest.raises(InputError, match="--config names a file"):
        parsed("--config")

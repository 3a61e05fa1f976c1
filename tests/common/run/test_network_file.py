"""A network's file: its weights, or those that a learner's checkpoint published."""

import json
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save

from common.errors import InputError
from common.network import build_network
from common.run.network_file import (
    decode_network_file,
    encode_network_file,
    load_network_file,
)
from common.settings.presets import PRESETS
from common.settings.stored_config import to_json
from tests.common.protocol.test_weights import small, tensors

CONFIG = PRESETS["fast"]


def test_of_a_checkpoint_the_weights_that_actors_got_are_taken(tmp_path: Path) -> None:
    online, average, network = tensors(small(1)), tensors(small(2)), small(3)
    checkpoint = {f"target.{name}": torch.zeros(value.shape) for name, value in online.items()}
    for prefix, published in (("online.", online), ("average.", average)):
        checkpoint |= {f"{prefix}{name}": value for name, value in published.items()}
        assert decode_network_file(save(checkpoint)).keys() == published.keys()
        (tmp_path / "checkpoint.safetensors").write_bytes(save(checkpoint))
        load_network_file(network, tmp_path / "checkpoint.safetensors", "this run")
        for name, value in network.state_dict().items():
            assert torch.equal(value, published[name])


def test_a_file_holds_the_weights_and_the_settings_of_their_training(tmp_path: Path) -> None:
    network, other = (build_network(CONFIG, 6) for _ in range(2))
    file = tmp_path / "network.safetensors"
    file.write_bytes(encode_network_file(network, CONFIG))
    load_network_file(other, file, "this run")
    for one, same in zip(network.parameters(), other.parameters(), strict=True):
        assert torch.equal(one, same)
    with safe_open(file, "np") as found:
        assert json.loads(found.metadata()["config"]) == json.loads(to_json(CONFIG))


def test_what_cannot_be_loaded_is_told_with_what_to_do(tmp_path: Path) -> None:
    network, file = build_network(CONFIG, 6), tmp_path / "network.safetensors"
    with pytest.raises(InputError, match=r"^there is no .*network\.safetensors: name another"):
        load_network_file(network, file, "this game")
    file.write_bytes(b"none")
    with pytest.raises(InputError, match="holds no network"):
        load_network_file(network, file, "this game")
    file.write_bytes(encode_network_file(build_network(CONFIG, 4), CONFIG))
    with pytest.raises(InputError, match=r"does not fit this game .* choose what it was"):
        load_network_file(network, file, "this game")

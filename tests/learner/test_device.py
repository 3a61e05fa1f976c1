"""Which hardware and which precision are chosen, without that hardware."""

import pytest
import torch

from learner.device import PrecisionChoice, choose_device


@pytest.mark.parametrize(
    ("capability", "precision", "bfloat16"),
    [
        ((7, 5), "auto", False),  # a T4 computes it in float32, after turning every number over
        ((7, 5), "bfloat16", True),
        ((9, 0), "auto", True),
        ((9, 0), "float32", False),
    ],
)
def test_bfloat16_is_chosen_by_itself_where_a_gpu_has_it(
    capability: tuple[int, int],
    precision: PrecisionChoice,
    bfloat16: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def supported(including_emulation: bool = True) -> bool:
        return including_emulation or capability[0] >= 8

    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", supported)
    assert choose_device("auto", precision).bfloat16 is bfloat16
    assert choose_device("auto", precision).torch == torch.device("cuda")

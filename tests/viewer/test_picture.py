"""Pictures replace earlier ones once they are whole."""

from pathlib import Path

import numpy as np
import pytest

from common.errors import InputError
from tests.full_disk import files_of_at_most
from viewer.picture import write_picture

NOISE = np.random.default_rng(1).integers(0, 255, (64, 64, 3), np.uint8)


def test_a_picture_for_which_there_is_no_room_leaves_the_earlier_one(tmp_path: Path) -> None:
    path = tmp_path / "p.png"
    write_picture(path, NOISE[:2])
    before = path.read_bytes()
    with (
        files_of_at_most(4096),
        pytest.raises(InputError, match=r"p\.png cannot be written"),
    ):
        write_picture(path, NOISE)
    assert path.read_bytes() == before
    path.unlink()
    with (
        files_of_at_most(4096),
        pytest.raises(InputError, match=r"p\.png cannot be written"),
    ):
        write_picture(path, NOISE)
    assert list(tmp_path.iterdir()) == []

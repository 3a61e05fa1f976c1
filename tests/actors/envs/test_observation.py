"""Shrinking by area and stacking by time."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.envs.observation import FrameStack, shrink


def test_shrinking_averages_what_a_pixel_covers() -> None:
    # 168 × 252 to 84 × 84: blocks of 2 rows × 3 columns.
    grey = np.random.default_rng(0).integers(256, size=(168, 252)).astype(np.uint8)
    means = grey.reshape(84, 2, 84, 3).mean(axis=(1, 3))
    frame = shrink(grey)
    assert frame.dtype == np.uint8
    assert np.abs(frame - means).max() <= 0.5 + 1e-6


@settings(max_examples=30)
@given(st.integers(1, 6), st.lists(st.booleans(), max_size=20))
def test_a_state_is_the_episodes_last_frames_the_first_repeated(
    frame_stack: int, restarts: list[bool]
) -> None:
    frames = FrameStack(frame_stack)
    seen: list[int] = []
    for number, restart in enumerate([True, *restarts]):
        frame = np.full((84, 84), number, np.uint8)
        before, kept = frames.state, frames.state.copy()
        (frames.restart if restart else frames.push)(frame)
        seen = [number] * frame_stack if restart else [*seen, number]
        assert frames.state.shape == (frame_stack, 84, 84)
        assert (before == kept).all()
        assert (frames.state == np.array(seen[-frame_stack:], np.uint8)[:, None, None]).all()

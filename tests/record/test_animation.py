import io

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from gvla2.record.motion import FrameReel, gif


def frame(k: int, size: int = 32) -> np.ndarray:
    image = np.full((size, size, 3), 180, dtype=np.uint8)
    image[k % size, : size // 2] = (255, 40, 20)
    return image


def test_every_frame_is_in_the_gif() -> None:
    with Image.open(io.BytesIO(gif([frame(k) for k in range(23)], fps=10))) as picture:
        assert picture.n_frames == 23
        durations = []
        for k in range(picture.n_frames):
            picture.seek(k)
            durations.append(picture.info["duration"])
    assert durations[:-1] == [100] * 22
    assert durations[-1] == 1300


def test_a_large_animation_is_kept_small() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (24, 96, 96, 3), dtype=np.uint8)
    small = gif(list(noise), max_bytes=60_000)
    assert len(small) < 0.5 * len(gif(list(noise), max_bytes=10**9))
    with Image.open(io.BytesIO(small)) as picture:
        assert picture.n_frames >= 6


@given(st.integers(1, 400), st.integers(2, 24))
@settings(max_examples=40, deadline=None)
def test_a_reel_thins_out_evenly(count: int, limit: int) -> None:
    reel = FrameReel(limit=limit)
    for k in range(count):
        reel.add(np.full((1, 1, 3), [k // 256, k % 256, 0], dtype=np.uint8))
    kept = [int(f[0, 0, 0]) * 256 + int(f[0, 0, 1]) for f in reel.frames]
    assert len(kept) <= limit
    assert kept[0] == 0
    assert kept[-1] == count - 1
    if count <= limit:
        assert kept == list(range(count))
    else:
        assert len(kept) > limit // 2
        steps = np.diff(kept[:-1])
        assert len(set(steps.tolist())) <= 1
        assert kept[-1] - kept[-2] <= 2 * max(steps, default=count)


def test_a_reel_keeps_copies_and_reduces_large_frames() -> None:
    reel = FrameReel(side=20)
    image = np.zeros((30, 40, 3), dtype=np.uint8)
    reel.add(image)
    small = np.zeros((10, 10, 3), dtype=np.uint8)
    reel.add(small)
    small[:] = 255
    assert reel.frames[0].shape == (15, 20, 3)
    assert reel.frames[1].max() == 0

import io

import numpy as np
import PIL.Image
import pytest

from pentimento.report.pictures import difference, resized, time_lapse


def solid(level: int, shape: tuple[int, int] = (4, 6)) -> np.ndarray:
    return np.full((*shape, 3), level, dtype=np.uint8)


def test_the_difference_is_the_root_mean_square_over_channels() -> None:
    other = solid(0)
    other[0, 0] = (255, 0, 0)
    found = difference(solid(0), other)
    assert found[0, 0] == pytest.approx(np.sqrt(1 / 3)) and found[1:].max() == 0


def test_squares_of_differences_average_to_the_mse() -> None:
    one, other = (np.random.default_rng(seed).integers(0, 256, (4, 6, 3), dtype=np.uint8) for seed in (0, 1))
    mse = np.square(one / 255 - other / 255).mean()
    assert np.square(difference(one, other)).mean() == pytest.approx(mse, rel=1e-5)


def test_a_finer_photograph_is_averaged_in_linear_light() -> None:
    stripes = solid(0, (8, 12))
    stripes[::2] = 255
    assert resized(stripes, (4, 6, 3)) == pytest.approx(np.full((4, 6, 3), 0.7354), abs=1e-3)  # sRGB of half the light


def test_the_time_lapse_keeps_every_frame_and_holds_the_last() -> None:
    frames = [solid(level) for level in (250, 120, 10)]
    data = time_lapse(frames, 300)
    assert data == time_lapse(frames, 300)
    with PIL.Image.open(io.BytesIO(data)) as lapse:
        assert lapse.n_frames == 3 and lapse.info["loop"] == 0
        for number, level in enumerate((250, 120, 10)):
            lapse.seek(number)
            assert abs(int(np.asarray(lapse.convert("RGB")).mean()) - level) <= 4
            assert lapse.info["duration"] == (300 if number < 2 else 3600)

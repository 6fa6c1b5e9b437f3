"""From table rows to tensors: frames, resolution, padding, foreign ink."""

import cv2
import numpy as np
import pytest
import torch

from pentimento.contracts.errors import ContractError
from pentimento.dynamics.strokes.samples import INK_THRESHOLD, inked_share, load_samples, resample_path
from tests.dynamics.strokes.conftest import stroke_row, table

LINE = np.column_stack(
    [np.linspace(0, 1, 5), np.linspace(0.03, 0.05, 5), np.full(5, 0.05), np.full(5, -1e-3), np.zeros(5)]
)
WHITE = np.full((80, 120, 3), 255, np.uint8)  # 2 px/mm


def drawn(*lines: tuple[tuple[int, int], tuple[int, int]]) -> np.ndarray:
    image = WHITE.copy()
    for start, end in lines:
        cv2.line(image, start, end, (25, 25, 51), 4)
    return image


# The line at y = 50 mm stands 10 mm, 20 px, below the window's top; x = 30 to 50 mm is columns 40 to 80.
STROKE = ((40, 20), (80, 20))


def test_ink_lies_where_the_path_is_in_pixels() -> None:
    samples = load_samples(table([stroke_row(LINE, WHITE, drawn(STROKE), 0)]), 9, 2000.0, 0.008)
    pixels = samples.view.to_pixels(samples.path[..., 1:3])[0].round().long()
    assert samples.ink[0, pixels[:, 1], pixels[:, 0]].all()
    rows = samples.ink[0].any(1).nonzero().flatten()
    assert abs(float(rows.float().mean()) - float(pixels[0, 1])) <= 1


def test_ink_that_does_not_touch_the_path_is_put_back() -> None:
    foreign = ((20, 32), (90, 32))
    one = load_samples(table([stroke_row(LINE, WHITE, drawn(STROKE), 0)]), 9, 2000.0, 0.008)
    two = load_samples(table([stroke_row(LINE, WHITE, drawn(STROKE, foreign), 0)]), 9, 2000.0, 0.008)
    torch.testing.assert_close(one.after, two.after)


def test_finer_photographs_are_averaged_down() -> None:
    row = stroke_row(LINE, WHITE, drawn(STROKE), 0)
    fine, coarse = (load_samples(table([row]), 9, k, 0.05) for k in (2000.0, 1000.0))
    assert fine.after.shape[1:3] == (80, 120)
    assert coarse.after.shape[1:3] == (40, 60)
    assert float(coarse.pixels_per_m[0]) == pytest.approx(1000)
    assert float(fine.after.mean()) == pytest.approx(float(coarse.after.mean()), abs=1e-4)


def test_the_rounding_of_windows_does_not_decide_how_far_a_photograph_is_averaged_down() -> None:
    rng = np.random.default_rng(0)
    rows = []
    for number, (x, y) in enumerate(rng.uniform(0, 0.3, (16, 2))):
        line = LINE + np.array([0, x, y, 0, 0])
        row = stroke_row(line, WHITE, drawn(STROKE), number)
        window = np.array([x + 0.01, y + 0.02, x + 0.07, y + 0.06], np.float32)
        rows.append(row | {"window_m": window.tolist()})
    samples = load_samples(table(rows), 9, 2000.0 / 1.5, 0.05)
    assert samples.after.shape[1:3] == (40, 60)
    assert torch.allclose(samples.pixels_per_m, torch.tensor(1000.0), rtol=1e-3)


def test_windows_of_other_sizes_are_padded_and_the_padding_does_not_count() -> None:
    long = LINE.copy()
    long[:, 1] = np.linspace(0.02, 0.06, 5)
    rows = [stroke_row(LINE, WHITE, drawn(STROKE), 0), stroke_row(long, WHITE, drawn(STROKE), 1)]
    samples = load_samples(table(rows), 9, 2000.0, 0.005)
    assert samples.valid[1].all()
    assert 0 < float(samples.valid[0].mean()) < 1
    assert not samples.ink[samples.valid == 0].any()


def test_paths_are_resampled_at_equal_steps() -> None:
    path = np.zeros((4, 5))
    path[:, 1] = [0.0, 0.001, 0.002, 0.03]
    steps = np.diff(resample_path(path, 31)[:, 1])
    np.testing.assert_allclose(steps, 0.001)


def test_a_bend_gets_the_points_that_a_straight_line_does_not_need() -> None:
    """30 mm straight, then three loops of 0.5 mm radius: no 24 equal steps follow them."""
    turn = np.linspace(0, 6 * np.pi, 400)
    x = np.concatenate([np.linspace(0, 0.03, 200), 0.03 + 5e-4 * np.sin(turn)])
    y = np.concatenate([np.zeros(200), 5e-4 * (1 - np.cos(turn))])
    path = np.stack([np.arange(600), x, y, 0 * x, 0 * x], axis=1).astype(float)

    def farthest_m(line: np.ndarray) -> float:
        """From the path, of points along the line."""
        share = np.linspace(0, len(line) - 1, 2000)
        points = np.stack([np.interp(share, np.arange(len(line)), line[:, axis]) for axis in (1, 2)], axis=1)
        return float(np.linalg.norm(points[:, None] - path[:, 1:3], axis=-1).min(1).max())

    even, close = resample_path(path, 24), resample_path(path, 24, 5e-5)
    assert farthest_m(even) > 4e-4 and farthest_m(close) < 1.5e-4
    np.testing.assert_allclose(close[[0, -1]], path[[0, -1]], atol=1e-9)
    assert (np.diff(close[:, 0]) > 0).all()  # times stay in order
    np.testing.assert_array_equal(resample_path(path[:200], 24, 5e-5), resample_path(path[:200], 24))


def test_a_yaw_that_passes_half_a_turn_does_not_turn_back_through_zero() -> None:
    path = np.zeros((2, 5))
    path[:, 1], path[:, 4] = [0.0, 0.01], np.deg2rad([179, -179])
    between = resample_path(path, 5)[:, 4]
    np.testing.assert_allclose(np.rad2deg(between) % 360, [179, 179.5, 180, 180.5, 181])


def test_a_path_that_does_not_move_keeps_its_press() -> None:
    path = np.zeros((3, 5))
    path[:, 3] = [-1e-3, -2e-3, -3e-3]
    np.testing.assert_allclose(resample_path(path, 5)[:, 3], [-1e-3, -1.5e-3, -2e-3, -2.5e-3, -3e-3])


def test_inked_share_runs_from_ground_to_paint() -> None:
    before, color = torch.tensor([0.9, 0.8, 0.7]), torch.tensor([0.1, 0.2, 0.3])
    for share in (0.0, 0.25, 1.0):
        assert float(inked_share(before, before + share * (color - before), color)) == pytest.approx(share, abs=1e-6)
    assert float(inked_share(before, before, before)) == 0 < INK_THRESHOLD


def test_an_empty_table_is_refused() -> None:
    empty = table([stroke_row(LINE, WHITE, WHITE, 0)]).slice(0, 0)
    with pytest.raises(ContractError, match="no rows"):
        load_samples(empty, 9, 2000.0, 0.005)


def test_a_row_that_makes_no_sample_is_named() -> None:
    deep = np.full((80, 120), 65535, np.uint16)
    far = stroke_row(LINE + np.array([0, 5, 0, 0, 0]), WHITE, WHITE, 1)
    for bad, reason in ((stroke_row(LINE, deep, deep, 1), "uint16 pixels"), (far, "does not overlap")):
        with pytest.raises(ContractError, match=rf"^Row 1 of the strokes table: .*{reason}"):
            load_samples(table([stroke_row(LINE, WHITE, drawn(STROKE), 0), bad]), 9, 2000.0, 0.008)


def test_an_unknown_colour_is_taken_as_black() -> None:
    row = stroke_row(LINE, WHITE, drawn(STROKE), 0)
    unknown = load_samples(table([row | {"color_srgb": [float("nan")] * 3}]), 9, 2000.0, 0.008)
    black = load_samples(table([row | {"color_srgb": [0.0] * 3}]), 9, 2000.0, 0.008)
    assert all(torch.equal(one, other) for one, other in zip(unknown, black, strict=True))

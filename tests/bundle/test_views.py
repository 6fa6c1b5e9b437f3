"""Resizing equals PyTorch's, and random views are squares of the picture."""

import numpy as np
import pytest
import torch
from torch.nn.functional import interpolate

from pentimento.bundle.views import random_views, resizing_matrix


@pytest.mark.parametrize(
    ("size", "new_size"), [(128, 64), (64, 64), (96, 64), (50, 64), (130, 16), (7, 16), (301, 224)]
)
def test_resizing_matrix_equals_pytorch_bicubic(size: int, new_size: int) -> None:
    lines = torch.eye(size)[None, None]
    expected = interpolate(lines, (new_size, size), mode="bicubic", antialias=True, align_corners=False)[0, 0]
    np.testing.assert_allclose(resizing_matrix(size, new_size), expected, atol=2e-5)


def test_resizing_matrix_preserves_the_mean() -> None:
    np.testing.assert_allclose(resizing_matrix(99, 32).sum(1), 1, atol=1e-6)
    np.testing.assert_array_equal(resizing_matrix(32, 32), np.eye(32))


def test_views_are_slightly_rotated_squares_inside_the_picture() -> None:
    views = random_views(500, np.random.default_rng(0))
    side = np.linalg.norm(views[:, :, 0], axis=1)
    turn = np.arctan2(views[:, 1, 0], views[:, 0, 0])
    np.testing.assert_allclose((views[:, :, 0] * views[:, :, 1]).sum(1), 0, atol=1e-6)
    assert 0.45 <= side.min() < 0.47 and 1.08 < side.max() <= 1.1
    assert 0.11 < np.abs(turn).max() <= 0.12 + 1e-6
    assert (np.abs(views[:, :, 2]).max(1) <= np.abs(1 - side) + 1e-6).all()

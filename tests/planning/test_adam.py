"""Adam is the published one, in place."""

import numpy as np
import pytest
import torch

from pentimento.planning.adam import _BETAS, Adam


def test_adam_agrees_with_torch() -> None:
    rng = np.random.default_rng(0)
    array = rng.normal(size=(4, 3)).astype(np.float32)
    other = torch.tensor(array.copy(), requires_grad=True)
    ours, theirs = Adam([array]), torch.optim.Adam([other], lr=1.0, betas=_BETAS)
    for step in range(12):
        gradient = rng.normal(size=array.shape).astype(np.float32) * 10.0 ** -(step % 4)
        rate = 0.1 / (1 + step)
        ours.step([gradient], [rate])
        other.grad = torch.from_numpy(gradient)
        theirs.param_groups[0]["lr"] = rate
        theirs.step()
        np.testing.assert_allclose(array, other.detach().numpy(), atol=1e-6)


def test_first_adam_step_is_the_rate_against_the_sign() -> None:
    array = np.zeros(3, np.float32)
    Adam([array]).step([np.array([1e-3, -5.0, 0.0], np.float32)], [0.2])
    np.testing.assert_allclose(array, [-0.2, 0.2, 0.0], rtol=1e-4)


def test_adam_minimises_a_quadratic_at_separate_rates() -> None:
    arrays = [np.full(2, 3.0, np.float32), np.full(3, -2.0, np.float32)]
    adam = Adam(arrays)
    for step in range(200):
        share = 1 - step / 200
        adam.step([2 * array for array in arrays], [0.1 * share, 0.0])
    assert np.abs(arrays[0]).max() < 0.01
    assert (arrays[1] == -2).all()
    assert arrays[0].dtype == np.float32
    with pytest.raises(ValueError, match="zip"):
        adam.step([arrays[0]], [0.1])

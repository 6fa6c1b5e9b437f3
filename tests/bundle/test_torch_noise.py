"""Random normal numbers are the workshop's."""

import numpy as np
import pytest
import torch

from pentimento.bundle.sampler import normal, seed_for
from pentimento.contracts.errors import ContractError
from pentimento.copainting.jobs import generator_for


@pytest.mark.parametrize("shape", [(1, 8, 16, 16), (16,), (17,), (5, 7), (1, 4, 33, 9)])
@pytest.mark.parametrize("key", [(0, 0), (3, 4), (123456789, 2)])
def test_the_numbers_are_those_of_torch(shape: tuple[int, ...], key: tuple[int, ...]) -> None:
    theirs = torch.randn(shape, generator=generator_for(*key)).numpy()
    np.testing.assert_allclose(normal(shape, seed_for(*key)), theirs, atol=3e-6)


def test_keys_of_other_lengths_give_other_noise() -> None:
    assert not np.allclose(normal((64,), seed_for(1)), normal((64,), seed_for(1, 0)))


def test_few_numbers_are_refused() -> None:
    with pytest.raises(ContractError, match="16"):
        normal((3, 5), 0)

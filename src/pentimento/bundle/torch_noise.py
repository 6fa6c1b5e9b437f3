"""The workshop's random normal numbers without the workshop: PyTorch's generator, restated in numpy.

A goal picture depends on the noise it starts from. So that robot and workshop see the same goal at the same seed, this
gives the numbers of ``torch.randn`` on a CPU: a Mersenne twister's 24-bit uniform numbers, in blocks of 16, through
Box and Muller (1958). PyTorch takes another way below 16 numbers, which is not restated.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError

_BLOCK = 16


def seed_for(*key: int) -> int:
    """The seed of a key such as (seed, number), as ``copainting.seeds.generator_for`` makes it."""
    # numpy pads keys with zeros: without its length, (1, 0) would be (1,).
    state = np.random.SeedSequence((len(key), *key)).generate_state(2)
    return int(state[0]) << 31 ^ int(state[1])


def normal(shape: tuple[int, ...], seed: int) -> NDArray[np.float32]:
    """``torch.randn(shape, generator=torch.Generator().manual_seed(seed))`` to float32's rounding.

    Raises:
        ContractError: fewer than 16 numbers.
    """
    count = math.prod(shape)
    if count < _BLOCK:
        raise ContractError(f"{count} random numbers are asked for; from {_BLOCK} on they are those of the workshop.")
    twister = np.random.RandomState(seed & 0xFFFFFFFF)
    uniform = _uniform(twister, count)
    whole = count - count % _BLOCK
    numbers = np.empty(count, np.float32)
    numbers[:whole] = _box_muller(uniform[:whole])
    if whole < count:  # the last block is drawn anew and laid over the end
        numbers[-_BLOCK:] = _box_muller(_uniform(twister, _BLOCK))
    return numbers.reshape(shape)


def _uniform(twister: np.random.RandomState, count: int) -> NDArray[np.float32]:
    """[count] in [0, 1): the low 24 bits of each 32-bit number."""
    raw = twister.randint(0, 2**32, count, dtype=np.uint64) & 0xFFFFFF
    return (raw.astype(np.float64) / 2**24).astype(np.float32)


def _box_muller(uniform: NDArray[np.float32]) -> NDArray[np.float32]:
    """Normal numbers of blocks of 16: the first eight and the last eight of a block make pairs."""
    pairs = uniform.reshape(-1, 2, _BLOCK // 2)
    radius = np.sqrt(-2 * np.log1p(-pairs[:, 0].astype(np.float64)))
    angle = 2 * np.pi * pairs[:, 1].astype(np.float64)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1).astype(np.float32).ravel()

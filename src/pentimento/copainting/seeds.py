"""Random numbers that depend on what they are for, not on what was drawn before: resuming changes nothing."""

from __future__ import annotations

import numpy as np
import torch


def generator_for(*key: int) -> torch.Generator:
    """PyTorch's generator for a key such as (seed, step)."""
    # numpy pads keys with zeros: without its length, (1, 0) would be (1,).
    state = np.random.SeedSequence((len(key), *key)).generate_state(2)
    return torch.Generator().manual_seed(int(state[0]) << 31 ^ int(state[1]))

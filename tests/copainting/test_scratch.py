"""Scratch is found again by equal settings and inputs, and by no others; random numbers depend on their key."""

from pathlib import Path

import torch

from pentimento.copainting.scratch import scratch_folder
from pentimento.copainting.seeds import generator_for


def test_another_setting_or_input_is_another_folder() -> None:
    root = Path("scratch")
    first = scratch_folder(root, "fit", {"a": 1, "b": 2.5}, {"data": "x"})
    assert first == scratch_folder(root, "fit", {"b": 2.5, "a": 1}, {"data": "x"})
    others = [
        scratch_folder(root, "fit", {"a": 2, "b": 2.5}, {"data": "x"}),
        scratch_folder(root, "fit", {"a": 1, "b": 2.5}, {"data": "y"}),
        scratch_folder(root, "other", {"a": 1, "b": 2.5}, {"data": "x"}),
    ]
    assert len({first, *others}) == 4


def test_generators_of_neighbouring_keys_are_unlike() -> None:
    keys = [(0, 0), (0, 1), (1, 0), (0, 1, 0), (1, 1)]
    drawn = [torch.randn(4000, generator=generator_for(*key)) for key in keys]
    correlation = torch.corrcoef(torch.stack(drawn)) - torch.eye(len(keys))
    assert float(correlation.abs().max()) < 0.1
    assert torch.equal(drawn[1], torch.randn(4000, generator=generator_for(0, 1)))

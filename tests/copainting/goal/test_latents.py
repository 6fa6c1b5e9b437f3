"""Latents that are encoded part by part equal those that are encoded at once, also after an interruption."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import torch

from pentimento.contracts.errors import ContractError
from pentimento.copainting.goal.denoising import encode_pairs
from pentimento.copainting.goal.latents import encode_parts
from pentimento.copainting.goal.training import train_goal_planner
from pentimento.copainting.scenes.edits import Pair
from tests.copainting.goal_planners import TRAINING, small_pairs, small_planner

Parts = list[Callable[[], Sequence[Pair]]]


def parts_of(pairs: Sequence[Pair], sizes: Sequence[int], called: list[int]) -> Parts:
    """Parts that note that they are called."""

    def part(number: int, chosen: Sequence[Pair]) -> Sequence[Pair]:
        called.append(number)
        return chosen

    starts = [sum(sizes[:number]) for number in range(len(sizes))]
    return [partial(part, n, pairs[at : at + size]) for n, (at, size) in enumerate(zip(starts, sizes, strict=True))]


@pytest.mark.parametrize("sizes", [[7], [3, 4], [1, 0, 5, 1]])
def test_parts_give_the_latents_of_all_pairs_in_order(tmp_path: Path, sizes: list[int]) -> None:
    planner, pairs = small_planner(), small_pairs(7)
    at_once = encode_pairs(planner, pairs)
    by_parts = encode_parts(planner, parts_of(pairs, sizes, []), "32-true", tmp_path)
    for name in ("input", "target"):
        one, other = (each.latents[getattr(each, name)] for each in (at_once, by_parts))
        torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-5)
    assert torch.equal(at_once.tokens, by_parts.tokens)
    assert (tmp_path / "latents.bin").stat().st_size == by_parts.latents.numel() * 4


def test_each_part_is_encoded_once_also_after_an_interruption(tmp_path: Path) -> None:
    planner, pairs = small_planner(), small_pairs(7)
    called: list[int] = []
    parts = parts_of(pairs, [3, 2, 2], called)

    def killed() -> Sequence[Pair]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        encode_parts(planner, [*parts[:2], killed], "32-true", tmp_path)
    (tmp_path / "part-00002.unfinished").write_bytes(b"half a file")
    resumed = encode_parts(planner, parts, "32-true", tmp_path)
    assert called == [0, 1, 2]
    at_once = encode_parts(planner, parts_of(pairs, [3, 2, 2], []), "32-true", tmp_path / "other")
    assert all(torch.equal(value, getattr(at_once, name)) for name, value in vars(resumed).items())


def test_training_on_mapped_latents_equals_training_on_those_in_memory(tmp_path: Path) -> None:
    weights = []
    for mapped in (False, True):
        planner = small_planner()
        pairs = encode_parts(planner, parts_of(small_pairs(7), [4, 3], []), "32-true", tmp_path)
        if not mapped:
            pairs = replace(pairs, latents=pairs.latents.clone())
        train_goal_planner(planner, pairs, replace(TRAINING, steps=3), scratch=None, log=lambda *_: None)
        weights.append([weight.clone() for weight in planner.unet.parameters()])
    assert all(torch.equal(one, other) for one, other in zip(*weights, strict=True))


def test_no_pair_and_pictures_of_several_sizes_are_refused(tmp_path: Path) -> None:
    planner, (pair,) = small_planner(), small_pairs(1)
    with pytest.raises(ContractError, match="no pair"):
        encode_parts(planner, [list], "32-true", tmp_path / "none")
    small = replace(pair, input=pair.input[:8], target=pair.target[:8])
    with pytest.raises(ContractError, match="2 sizes"):
        encode_parts(planner, [lambda: [pair], lambda: [small]], "32-true", tmp_path / "two")

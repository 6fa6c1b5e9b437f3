"""Latents of more pairs than memory holds: encoded part by part, each part once, and mapped from one file.

A killed run continues with the parts that are missing. Training reads the latents of a step's pairs from the file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from pentimento.contracts.errors import ContractError
from pentimento.copainting.goal.denoising import LatentPairs, encode_pairs
from pentimento.copainting.goal.planner import GoalPlanner
from pentimento.copainting.scenes.edits import Pair
from pentimento.semantics.devices import Precision

_LATENTS: Final = "latents.bin"


def encode_parts(
    planner: GoalPlanner, parts: Iterable[Callable[[], Sequence[Pair]]], precision: Precision, folder: Path
) -> LatentPairs:
    """`encode_pairs` of the pairs of all parts in order, with the latents in a file of the folder.

    A picture is stored once for each part that it occurs in. The parts, one of which is in memory at a time, must be
    those of an earlier call with the same folder; they are called only where the folder lacks their latents.

    Raises:
        ContractError: no pair, pictures of a size that the planner does not take, or of several sizes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for number, part in enumerate(parts):
        file = folder / f"part-{number:05d}.safetensors"
        if not file.exists():
            pairs = part()
            _save(vars(encode_pairs(planner, pairs, precision)) if pairs else {}, file)
        files.append(file)
    return _joined(files, folder / _LATENTS)


def _save(tensors: dict[str, Tensor], file: Path) -> None:
    unfinished = file.with_suffix(".unfinished")
    save_file({name: tensor.contiguous() for name, tensor in tensors.items()}, unfinished)
    unfinished.replace(file)


def _joined(files: Sequence[Path], place: Path) -> LatentPairs:
    """All parts as one, with the latents in the file `place`."""
    shapes: set[tuple[int, ...]] = set()
    indices: dict[str, list[Tensor]] = {"input": [], "target": [], "tokens": []}
    count = 0
    with place.open("wb") as out:
        for part in filter(None, map(load_file, files)):
            latents = part["latents"]
            shapes.add(tuple(latents.shape[1:]))
            out.write(latents.numpy().tobytes())
            for name, offset in (("input", count), ("target", count), ("tokens", 0)):
                indices[name].append(part[name] + offset)
            count += len(latents)
    if not shapes:
        raise ContractError("There is no pair of pictures to train the goal planner on; make the dataset larger.")
    if len(shapes) > 1:
        raise ContractError(f"The pairs' pictures are of {len(shapes)} sizes; their latents are {sorted(shapes)[:2]}.")
    (shape,) = shapes
    size = count * torch.Size(shape).numel()
    mapped = torch.from_file(str(place), shared=False, size=size, dtype=torch.float32)
    return LatentPairs(mapped.view(count, *shape), **{name: torch.cat(values) for name, values in indices.items()})

"""What an encoder learns from: pictures, each also as drawings of several styles, and captions as tokens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import torch
from numpy.typing import NDArray
from torch import Tensor
from transformers import CLIPTokenizer

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png
from pentimento.semantics.drawings import STYLES, draw

VIEWS = ("picture", *STYLES)
"""How each picture is seen; number in ``Examples.views``."""
_BLACK = {"lines", "hatching", "grey", "strokes"}


@dataclass(frozen=True, eq=False)
class Captioned:
    """Pictures and what is said of them. Where a table does not tell objects or colours, they are empty."""

    images: NDArray[np.uint8]
    """sRGB [N, H, W, 3]."""
    captions: list[list[str]]
    objects: list[list[str]]
    colors: list[list[str]]
    regions: NDArray[np.uint8]
    """[N, H, W]: 0 the ground, i + 1 object i."""


@dataclass(frozen=True, eq=False)
class Examples:
    """Pictures as tensors, with all that a step of training draws from."""

    views: Tensor
    """uint8 [N, V, 3, H, W] by ``VIEWS``."""
    tokens: Tensor
    """[C, T]: token ids of all distinct captions."""
    mask: Tensor
    """[C, T]: 1 where a token counts."""
    captions: list[list[int]]
    """For each picture its captions among C."""
    plain: list[list[int]]
    """For each picture the captions that name none of its colours; all of them where each does."""
    altered: list[list[list[int]]]
    """For each picture and each of its captions, captions that are wrong by one word; in the order of ``captions``."""
    altered_plain: list[list[list[int]]]
    """The same in the order of ``plain``."""
    prompts: list[int]
    """For each kind of object a caption that names it alone."""
    present: Tensor
    """[N, K]: whether a picture shows a kind."""
    regions: Tensor
    """uint8 [N, H, W]: 0 the ground, i + 1 object i."""
    region_kinds: Tensor
    """[N, R]: the kind of each region's number; -1 where there is no object."""


def captioned(table: pa.Table, side_px: int) -> Captioned:
    """The rows of a ``scenes`` table as arrays; ``captions`` falls back to ``caption``.

    Raises:
        ContractError: pictures of several sizes or of another side than ``side_px``, or no row.
    """
    images = [decode_png(row["bytes"]) for row in table.column("image").to_pylist()]
    shapes = {image.shape for image in images}
    if shapes != {(side_px, side_px, 3)}:
        found = ", ".join(sorted(" x ".join(map(str, shape)) for shape in shapes)) or "no picture"
        raise ContractError(f"The scenes hold {found}; the encoder learns from {side_px} x {side_px} x 3 only.")
    alone = [[caption] for caption in table.column("caption").to_pylist()]
    several = _lists(table, "captions")
    captions = [list(dict.fromkeys(more)) or one for one, more in zip(alone, several, strict=True)]
    regions = np.stack([decode_png(row["bytes"]) for row in table.column("regions").to_pylist()])
    return Captioned(np.stack(images), captions, _lists(table, "objects"), _lists(table, "colors"), regions)


def kinds_of(rows: Captioned) -> list[str]:
    """All kinds of objects, by name."""
    return sorted({kind for kinds in rows.objects for kind in kinds})


def drawn_views(images: NDArray[np.uint8], seed: int) -> NDArray[np.uint8]:
    """[N, V, H, W, 3]: each picture as it is and in each style; picture i depends on (seed, i) only."""
    views = []
    for index, image in enumerate(images):
        generators = (np.random.default_rng([seed, index, number]) for number in range(len(STYLES)))
        drawn = [draw(image, style, generator) for style, generator in zip(STYLES, generators, strict=True)]
        views.append([image, *drawn])
    return np.array(views)


def examples(rows: Captioned, tokenizer: CLIPTokenizer, seed: int) -> Examples:
    """All that training draws from."""
    numbers: dict[str, int] = {}

    def number(caption: str) -> int:
        return numbers.setdefault(caption, len(numbers))

    kinds = kinds_of(rows)
    colors = sorted({color for each in rows.colors for color in each})
    plain = [_plain(texts, named) for texts, named in zip(rows.captions, rows.colors, strict=True)]

    def wrong(index: int, texts: list[str]) -> list[list[int]]:
        groups = [(rows.objects[index], kinds), (rows.colors[index], colors)]
        return [[number(t) for t in _altered(text, groups, np.random.default_rng([seed, 2, index, n]))]
                for n, text in enumerate(texts)]  # fmt: skip

    captions = [[number(text) for text in texts] for texts in rows.captions]
    plain_numbers = [[number(text) for text in texts] for texts in plain]
    altered = [wrong(index, texts) for index, texts in enumerate(rows.captions)]
    altered_plain = [wrong(index, texts) for index, texts in enumerate(plain)]
    prompts = [number(prompt(kind)) for kind in kinds]
    found = tokenizer(list(numbers), padding=True, truncation=True, return_tensors="pt")
    present = torch.tensor([[kind in named for kind in kinds] for named in rows.objects], dtype=torch.float32)
    region_kinds = torch.full((len(rows.images), 1 + max(map(len, rows.objects))), -1)
    for index, named in enumerate(rows.objects):
        region_kinds[index, 1 : 1 + len(named)] = torch.tensor([kinds.index(kind) for kind in named])
    views = torch.from_numpy(drawn_views(rows.images, seed)).permute(0, 1, 4, 2, 3).contiguous()
    return Examples(
        views, found["input_ids"], found["attention_mask"], captions, plain_numbers, altered, altered_plain, prompts,
        present, torch.from_numpy(rows.regions), region_kinds,
    )  # fmt: skip


def is_black(view: int) -> bool:
    """Whether a view shows no colour."""
    return VIEWS[view] in _BLACK


def prompt(kind: str) -> str:
    """A caption that names one kind of object and nothing else."""
    return f"{'an' if kind[:1] in 'aeiou' else 'a'} {kind}"


def _plain(captions: Sequence[str], colors: Sequence[str]) -> list[str]:
    return [text for text in captions if not set(colors) & set(text.split())] or list(captions)


def _altered(caption: str, groups: list[tuple[list[str], list[str]]], generator: np.random.Generator) -> list[str]:
    """Up to four captions in which one word of a group is replaced by another of the group that is not there."""
    words = caption.replace(",", " ,").split()
    places = [(place, own, all_) for own, all_ in groups for place, word in enumerate(words) if word in own]
    texts = []
    for pick in generator.permutation(len(places)).tolist() * 4 if places else []:
        place, own, all_ = places[pick]
        others = [word for word in all_ if word not in own]
        if others:
            other = str(generator.choice(others))
            texts.append(" ".join([*words[:place], other, *words[place + 1 :]]).replace(" ,", ","))
    return texts[:4]


def _lists(table: pa.Table, name: str) -> list[list[str]]:
    if name not in table.column_names:
        return [[] for _ in range(table.num_rows)]
    return [list(value or []) for value in table.column(name).to_pylist()]

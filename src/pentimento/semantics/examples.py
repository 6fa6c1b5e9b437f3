"""Training data of an encoder: pictures, drawings of them in several styles, and tokenised captions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import torch
from numpy.typing import NDArray
from torch import Tensor
from transformers import CLIPTokenizer

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png
from pentimento.contracts.scenes import phrase, without_colors
from pentimento.semantics.drawings import STYLES, draw

VIEWS = ("picture", *STYLES)
"""The picture itself and each drawing style; the index of the second axis of `Examples.views`."""
_BLACK = {"lines", "hatching", "grey", "strokes"}


@dataclass(frozen=True, eq=False)
class Captioned:
    """Pictures with captions and regions. Objects and colours are empty if the table has none."""

    images: NDArray[np.uint8]
    """sRGB [N, H, W, 3]."""
    captions: list[list[str]]
    objects: list[list[str]]
    colors: list[list[str]]
    regions: NDArray[np.uint8]
    """[N, H, W]: 0 for the background, i + 1 for object i."""


@dataclass(frozen=True, eq=False)
class Examples:
    """Pictures as tensors, with everything that a training step samples from."""

    views: Tensor
    """uint8 [N, V, 3, H, W], by `VIEWS`."""
    tokens: Tensor
    """[C, T]: token ids of all distinct captions."""
    mask: Tensor
    """[C, T]: 1 for tokens, 0 for padding."""
    captions: list[list[int]]
    """For each picture, indices of its captions in C."""
    plain: list[list[int]]
    """For each picture, its captions without its colours; all captions if each names one."""
    altered: list[list[list[int]]]
    """For each picture and each of its `captions`, captions with one wrong word."""
    altered_plain: list[list[list[int]]]
    """The same for each of `plain`."""
    prompts: list[int]
    """For each kind of object, a caption that names it alone."""
    present: Tensor
    """[N, K]: whether a picture shows a kind."""
    regions: Tensor
    """uint8 [N, H, W]: 0 for the background, i + 1 for object i."""
    region_kinds: Tensor
    """[N, R]: the kind of each region label; -1 without an object."""


def captioned(table: pa.Table) -> Captioned:
    """The rows of a `scenes` table as arrays; without `captions`, `caption` is the only one.

    Raises:
        ContractError: pictures of several sizes, or no row.
    """
    images = [decode_png(row["bytes"]) for row in table.column("image").to_pylist()]
    shapes = {image.shape for image in images}
    if len(shapes) != 1:
        found = ", ".join(sorted(" x ".join(map(str, shape)) for shape in shapes)) or "no picture"
        raise ContractError(f"The scenes hold {found}; the encoder learns from pictures of one size.")
    alone = [[caption] for caption in table.column("caption").to_pylist()]
    several = _lists(table, "captions")
    captions = [list(dict.fromkeys(more)) or one for one, more in zip(alone, several, strict=True)]
    regions = np.stack([decode_png(row["bytes"]) for row in table.column("regions").to_pylist()])
    return Captioned(np.stack(images), captions, _lists(table, "objects"), _lists(table, "colors"), regions)


def kinds_of(rows: Captioned) -> list[str]:
    """All kinds of objects, sorted by name."""
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
    """The training data of captioned pictures."""
    numbers: dict[str, int] = {}

    def number(caption: str) -> int:
        return numbers.setdefault(caption, len(numbers))

    kinds = kinds_of(rows)
    colors = sorted({color for each in rows.colors for color in each})
    plain = [without_colors(texts, named) for texts, named in zip(rows.captions, rows.colors, strict=True)]

    def wrong(index: int, texts: list[str]) -> list[list[int]]:
        groups = [(rows.objects[index], kinds), (rows.colors[index], colors)]
        return [[number(t) for t in _altered(text, groups, np.random.default_rng([seed, 2, index, n]))]
                for n, text in enumerate(texts)]  # fmt: skip

    captions = [[number(text) for text in texts] for texts in rows.captions]
    plain_numbers = [[number(text) for text in texts] for texts in plain]
    altered = [wrong(index, texts) for index, texts in enumerate(rows.captions)]
    altered_plain = [wrong(index, texts) for index, texts in enumerate(plain)]
    prompts = [number(phrase(kind)) for kind in kinds]
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


def _altered(caption: str, groups: list[tuple[list[str], list[str]]], generator: np.random.Generator) -> list[str]:
    """Up to four captions in which one word of a group is replaced by another word of the group that does not apply."""
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

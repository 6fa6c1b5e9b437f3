"""What a goal planner is asked in its evaluation: held-out prompts on canvases that hold drawings of other prompts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png

Picture = NDArray[np.uint8]

_TRIES = 50


@dataclass(frozen=True, eq=False)
class Case:
    """One prompt on one begun canvas."""

    scene_id: str
    caption: str
    objects: tuple[str, ...]
    """Kinds that the prompt asks for; empty where the table does not tell."""
    image: Picture
    """The prompt's scene, uint8 [H, W, 3]."""
    other_image: Picture
    """The scene of which the canvas holds a drawing."""
    other_objects: tuple[str, ...]


def choose_cases(scenes: pa.Table, count: int, seed: int) -> list[Case]:
    """Up to `count` cases from a checked `scenes` table of one split, in the table's order.

    The other scene is another prompt's (thesis 6.6.1) and shares no kind of object with the prompt, where there is
    such a scene. Case i depends on the table and (seed, i) only.

    Raises:
        ContractError: fewer than two scenes, or pictures that are not squares of one size.
    """
    rows = scenes.to_pylist()
    if len(rows) < 2:
        raise ContractError(
            f"There are {len(rows)} held-out scenes; an evaluation needs two or more: draw more scenes."
        )
    images = [decode_png(row["image"]["bytes"]) for row in rows]
    sizes = {image.shape for image in images}
    if len(sizes) > 1 or next(iter(sizes))[0] != next(iter(sizes))[1]:
        raise ContractError(f"The held-out scenes are of sizes {sorted(sizes)[:3]}; make them squares of one size.")
    cases = []
    for index, row in enumerate(rows[:count]):
        other = _other(index, rows, np.random.default_rng([seed, index]))
        cases.append(
            Case(
                str(row.get("scene_id") or index), plain_caption(row), _objects(row), images[index], images[other],
                _objects(rows[other]),
            )
        )  # fmt: skip
    return cases


def plain_caption(row: dict[str, Any]) -> str:
    """The first wording that names none of the scene's colours, for one ink shows none; otherwise the first of all."""
    captions = [str(caption) for caption in (row.get("captions") or [row["caption"]])]
    colors = set(row.get("colors") or ())
    return next((caption for caption in captions if not colors & set(caption.split())), captions[0])


def _other(index: int, rows: Sequence[dict[str, Any]], generator: np.random.Generator) -> int:
    """Number of another scene; of those drawn, the first that shares no kind with this one."""
    asked = set(_objects(rows[index]))
    drawn = [int((index + generator.integers(1, len(rows))) % len(rows)) for _ in range(_TRIES)]
    return next((other for other in drawn if not asked & set(_objects(rows[other]))), drawn[0])


def _objects(row: dict[str, Any]) -> tuple[str, ...]:
    return tuple(str(kind) for kind in (row.get("objects") or ()))

"""Pairs of a partial and a full painting of captioned scenes, as rows of the `copaintings` contract (thesis 6.4.1)."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, to_uint8
from pentimento.contracts.images import decode_png, image_cell
from pentimento.contracts.scenes import phrase, read_scene, without_colors
from pentimento.copainting.scenes.collage import Place, opposite, place_around
from pentimento.copainting.synthesis.painter import Image, Painter, plan_painting
from pentimento.copainting.synthesis.partials import Partial, PartialsConfig, partials
from pentimento.planning.strokes.target import fit_to_canvas
from pentimento.robots.tools import Tool
from pentimento.semantics.encoder import as_images
from pentimento.semantics.scores import clip_score, saliency

Row = dict[str, Any]

_NAMED_SHARE: Final = 0.3  # of the `beside` pairs: the caption is the name of the thing, not a caption of its scene


def paint_scene(row: Mapping[str, Any], painter: Painter, config: PartialsConfig) -> list[Row]:
    """Rows of the `copaintings` contract for one row of `scenes`: one for each partial painting.

    They depend on the scene, the painter and the planner's seed only, not on other scenes.

    Raises:
        ContractError: the regions have another size than the picture.
    """
    setting, seed = painter.setting, item_seed(painter.setting.planner.seed, row["scene_id"])
    picture, regions = read_scene(row, f"Scene {row['scene_id']}")
    painting = plan_painting(painter, picture, seed)
    captions = usable_captions(row, painter.tool)
    fitted = to_uint8(linear_to_srgb(fit_to_canvas(picture, setting.planned_px)))
    salient = saliency(painter.encoder, as_images([fitted]), [captions[0]])[0].numpy()
    rng = np.random.default_rng([seed, 1])
    found = partials(
        painting.points_m(), salient, fit_labels(regions, setting.planned_px), setting.canvas_m, config=config, rng=rng
    )
    full = painting.picture(np.ones(len(painting.strokes), bool), setting.stored_px)
    order = rng.permutation(len(captions))
    whole = [captions[order[number % len(order)]] for number in range(len(found))]
    scores = clip_score(painter.encoder, as_images([full] * len(found)), whole).tolist() if found else []
    full_cell = image_cell(full)
    return [
        {
            "scene_id": row["scene_id"],
            "setting": painter.name,
            "strategy": partial.strategy,
            "region": partial.region,
            "seed": seed,
            "caption": missing_thing(row, partial, painter.tool) or caption,
            "medium": setting.words,
            "partial": image_cell(painting.picture(partial.kept, setting.stored_px)),
            "full": full_cell,
            "plan_id": f"{painter.name}/{row['scene_id']}/{seed}",
            "kept": partial.kept.tolist(),
            "clip_score": score,
            "scorer": painter.scorer,
            "split": row["split"],
        }
        for partial, caption, score in zip(found, whole, scores, strict=True)
    ]


def item_seed(seed: int, scene_id: str) -> int:
    """A seed of 31 bits that depends on the seed and the scene's id."""
    return int.from_bytes(hashlib.sha256(f"{seed} {scene_id}".encode()).digest()[:4], "big") >> 1


def usable_captions(row: Mapping[str, Any], tool: Tool) -> list[str]:
    """The captions of a scene that a tool can draw: without colours for a tool with one ink, if there are any."""
    captions = list(dict.fromkeys(row.get("captions") or [row["caption"]]))
    return captions if tool.color_srgb is None else without_colors(captions, row.get("colors"))


def missing_thing(row: Mapping[str, Any], partial: Partial, tool: Tool) -> str | None:
    """A request for the one thing that a partial painting lacks, if the scene names several things; otherwise None.

    The score of the pair remains that of the full painting with the scene's caption: it measures whether the robot can
    paint the scene.
    """
    kinds = row.get("objects") or []
    if partial.region is None or len(kinds) < 2 or partial.region > len(kinds):
        return None
    colors = row.get("colors") or [None] * len(kinds)
    color = None if tool.color_srgb is not None else colors[partial.region - 1]
    return phrase(kinds[partial.region - 1], color)


def fit_labels(labels: NDArray[np.uint8], shape: tuple[int, int]) -> NDArray[np.uint8]:
    """`fit_to_canvas` for a label mask [H, W]."""
    height, width = shape
    scale = max(height / labels.shape[0], width / labels.shape[1])
    crop_h, crop_w = round(height / scale), round(width / scale)
    top, left = (labels.shape[0] - crop_h) // 2, (labels.shape[1] - crop_w) // 2
    part = np.ascontiguousarray(labels[top : top + crop_h, left : left + crop_w])
    return np.asarray(cv2.resize(part, (width, height), interpolation=cv2.INTER_NEAREST), dtype=np.uint8)


def beside_pairs(
    paintings: Sequence[Row],
    scenes: Mapping[str, Mapping[str, Any]],
    captions_of: Callable[[Mapping[str, Any]], list[str]],
    *,
    together: Collection[frozenset[str]],
    number: int,
    seed: int,
) -> list[Row]:
    """Rows of the `copaintings` contract that ask for one thing beside another one that is drawn (thesis 6.6.1).

    Both paintings show one thing in one half of the sheet. Their strokes do not overlap, so the overlay of the two
    equals the model's prediction of both plans in turn. A few hundred plans thus give thousands of pairs.

    Args:
        paintings: rows of that contract for half scenes, from the blank sheet (strategy `all`).
        scenes: the half scenes by `scene_id`, see `scenes.collage.half_scenes`.
        captions_of: the captions of a half scene.
        together: pairs of kinds that may be combined. Scenes without kinds may be combined with any.
        number: at most, for each painting, with paintings of the same split.

    Each row has the id, the score and the split of the scene that is asked for. The pairs of a painting depend on the
    paintings and (seed, its index) only.
    """
    indices: dict[tuple[str, str], list[int]] = {}
    for index, row in enumerate(paintings):
        indices.setdefault((row["split"], scenes[row["scene_id"]]["arrangement"]), []).append(index)
    pictures = [decode_png(row["full"]["bytes"]) for row in paintings]
    rows = []
    for index, row in enumerate(paintings):
        generator = np.random.default_rng([seed, index])
        scene = scenes[row["scene_id"]]
        facing = indices.get((row["split"], opposite(scene["arrangement"])), [])
        fitting = [other for other in facing if _may_combine(scene, scenes[paintings[other]["scene_id"]], together)]
        paper, captions = decode_png(row["partial"]["bytes"]), captions_of(scene)
        for other in generator.permutation(fitting)[:number]:
            before, drawn = pictures[other], paintings[other]
            named = len(scene.get("objects") or ()) == 1 and generator.random() < _NAMED_SHARE
            caption = phrase(scene["objects"][0]) if named else captions[int(generator.integers(len(captions)))]
            rows.append(
                row
                | {
                    "strategy": "beside",
                    "caption": caption,
                    "partial": image_cell(before),
                    "full": image_cell(overlay(before, pictures[index], paper)),
                    "plan_id": f"{drawn['plan_id']} + {row['plan_id']}",
                    "kept": [True] * len(drawn["kept"]) + [False] * len(row["kept"]),
                }
            )
    return rows


def window_pairs(
    paintings: Sequence[Row],
    scenes: Mapping[str, Mapping[str, Any]],
    *,
    together: Collection[frozenset[str]],
    number: int,
    seed: int,
) -> list[Row]:
    """Rows of the `copaintings` contract that ask for one thing where another one is in view (thesis 6.6.1).

    Each painting shows one thing that fills the sheet. The other one lies around it or overlaps with it, as seen in a
    window of a larger sheet: its picture is moved and resized, not planned again.

    Args:
        paintings: rows of that contract for such scenes, from the blank sheet (strategy `all`).
        scenes: the scenes by `scene_id`.
        together: pairs of kinds that may be combined.
        number: for each painting, with paintings of the same split.

    Each row has the id, the score and the split of the scene that is asked for. The pairs of a painting depend on the
    paintings and (seed, its index) only.
    """
    rows = []
    pictures = [decode_png(row["full"]["bytes"]) for row in paintings]
    for index, row in enumerate(paintings):
        generator = np.random.default_rng([seed, index])
        scene, paper = scenes[row["scene_id"]], decode_png(row["partial"]["bytes"])
        fitting = [
            other
            for other, drawn in enumerate(paintings)
            if other != index
            and drawn["split"] == row["split"]
            and _may_combine(scene, scenes[drawn["scene_id"]], together)
        ]
        for other in generator.permutation(fitting)[:number]:
            before = _moved(pictures[other], paper, place_around(generator))
            rows.append(
                row
                | {
                    "strategy": "beside",
                    "partial": image_cell(before),
                    "full": image_cell(overlay(before, pictures[index], paper)),
                    "plan_id": f"{paintings[other]['plan_id']} + {row['plan_id']}",
                    "kept": [True] * len(paintings[other]["kept"]) + [False] * len(row["kept"]),
                }
            )
    return rows


def _moved(picture: Image, paper: Image, place: Place) -> Image:
    """A painting, sRGB [S, S, 3], in a place of an empty sheet."""
    side = picture.shape[0]
    shift = [side * (middle - place.size / 2) + 0.5 * (place.size - 1) for middle in (place.x, place.y)]
    matrix = np.array([[place.size, 0, shift[0]], [0, place.size, shift[1]]])
    colour = [float(value) for value in np.median(paper.reshape(-1, 3), axis=0)]
    moved = cv2.warpAffine(picture, matrix, (side, side), flags=cv2.INTER_LINEAR, borderValue=colour)
    return np.asarray(moved, dtype=np.uint8)


def overlay(one: Image, other: Image, paper: Image) -> Image:
    """Both paintings on one sheet, sRGB [H, W, 3]: each pixel is of the one that differs more from the paper."""
    first, second = (np.abs(picture.astype(np.int16) - paper).sum(-1) for picture in (one, other))
    return np.where((second > first)[..., None], other, one)


def _may_combine(one: Mapping[str, Any], other: Mapping[str, Any], together: Collection[frozenset[str]]) -> bool:
    kinds, others = one.get("objects") or (), other.get("objects") or ()
    return all(frozenset((a, b)) in together for a in kinds for b in others)

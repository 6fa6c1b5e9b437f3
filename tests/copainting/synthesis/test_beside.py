"""Pairs of one thing beside another: what is there stays, what is asked for comes, what is held out never meets."""

from typing import Any

import numpy as np

from pentimento.contracts.copaintings import CONTRACT
from pentimento.contracts.images import decode_png, encode_png
from pentimento.contracts.schema import arrow_schema
from pentimento.copainting.synthesis.beside import beside_pairs, laid_over
from pentimento.copainting.synthesis.pairs import Row

PAPER = np.full((16, 16, 3), 250, np.uint8)
KINDS = ("cup", "sun", "tree", "key", "cat", "fish")
TOGETHER = {frozenset((a, b)) for a in KINDS for b in KINDS} - {frozenset(("cup", "sun"))}


def png(picture: np.ndarray) -> dict[str, Any]:
    return {"bytes": encode_png(picture), "path": None}


def paintings() -> tuple[list[Row], dict[str, dict[str, Any]]]:
    rows, scenes = [], {}
    for place, kind in enumerate(KINDS):
        left = place % 2 == 0
        picture = PAPER.copy()
        picture[2 * place + 1, slice(1, 7) if left else slice(9, 15)] = 10
        name = f"scene_{place}/{'left' if left else 'right'}"
        scenes[name] = {"scene_id": name, "arrangement": name.split("/")[1], "objects": [kind]}
        rows.append({
            "scene_id": name, "setting": "marker", "strategy": "all", "region": None, "seed": place, "caption": "a bar",
            "partial": png(PAPER), "full": png(picture), "plan_id": f"plan_{place}", "kept": [False] * (place + 1),
            "clip_score": place / 10, "scorer": "s", "split": "val" if place >= 4 else "train",
        })  # fmt: skip
    return rows, scenes


def pairs(number: int = 9, seed: int = 0) -> list[Row]:
    rows, scenes = paintings()
    return beside_pairs(rows, scenes, lambda scene: [f"just a {scene['objects'][0]}"], TOGETHER, number, seed)


def test_the_first_painting_is_there_and_the_second_is_asked_for() -> None:
    for row in pairs():
        there, asked = (int(name.removeprefix("plan_")) for name in row["plan_id"].split(" + "))
        before, after = decode_png(row["partial"]["bytes"]), decode_png(row["full"]["bytes"])
        assert set(np.flatnonzero((before < 100).any((1, 2)))) == {2 * there + 1}
        assert set(np.flatnonzero((after < 100).any((1, 2)))) == {2 * there + 1, 2 * asked + 1}
        assert (after[before < 100] < 100).all()
        assert row["kept"] == [True] * (there + 1) + [False] * (asked + 1)
        assert KINDS[asked] in row["caption"] and row["clip_score"] == asked / 10
        assert row["strategy"] == "beside" and set(row) == set(arrow_schema(CONTRACT).names)


def test_only_facing_halves_of_one_split_meet_and_nothing_that_is_held_out() -> None:
    met = {tuple(sorted(map(int, row["plan_id"].replace("plan_", "").split(" + ")))) for row in pairs()}
    assert met == {(0, 3), (1, 2), (2, 3), (4, 5)}  # cup and sun (0, 1) are held out; 4 and 5 are another split


def test_so_many_for_each_and_the_same_for_the_same_seed() -> None:
    assert len(pairs(1)) == 6
    assert pairs(2, 1) == pairs(2, 1)
    assert any(pairs(1, seed) != pairs(1, 0) for seed in range(1, 5))


def test_laid_over_each_other_both_show_in_either_order() -> None:
    rows, _ = paintings()
    one, other = (decode_png(row["full"]["bytes"]) for row in rows[:2])
    assert (laid_over(one, other, PAPER) == np.minimum(one, other)).all()
    assert (laid_over(other, one, PAPER) == laid_over(one, other, PAPER)).all()
    assert (laid_over(one, PAPER, PAPER) == one).all()

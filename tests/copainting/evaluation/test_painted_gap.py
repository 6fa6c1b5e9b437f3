"""Gaps between scenes and their paintings: which rows count."""

import pyarrow as pa
import torch

from pentimento.contracts import copaintings, scenes
from pentimento.contracts.schema import arrow_schema
from pentimento.copainting.evaluation.painted_gap import painted_gap
from tests.copainting.goal_planners import small_encoder


def tables() -> tuple[pa.Table, pa.Table]:
    """Scenes, and co-paintings whose full paintings are other scenes: gaps differ."""
    known = scenes.example_table(8)
    rows = copaintings.example_table(8, seed=1).to_pylist()
    made = [
        row | {"scene_id": name, "region": None} for row, name in zip(rows, known["scene_id"].to_pylist(), strict=True)
    ]
    return known, pa.Table.from_pylist(made, schema=arrow_schema(copaintings.CONTRACT))


def test_each_painting_counts_once_and_requests_for_one_thing_do_not() -> None:
    torch.set_num_threads(1)
    known, pairs = tables()
    found = painted_gap(pairs, known, small_encoder())
    assert {name: row["paintings"] for name, row in found.items()} == {"delta_pix": 8, "delta_sem": 8}
    assert all(-1 <= row["r"] <= 1 for row in found.values())
    parts = pa.Table.from_pylist(
        [row | {"region": 1, "caption": "something else"} for row in pairs.to_pylist()], schema=pairs.schema
    )
    assert painted_gap(pa.concat_tables([pairs, pairs, parts]), known, small_encoder()) == found


def test_paintings_of_other_scenes_have_no_gap() -> None:
    known, pairs = tables()
    assert painted_gap(pairs, known.slice(0, 0), small_encoder()) == {}

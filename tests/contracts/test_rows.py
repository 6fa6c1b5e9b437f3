from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts import demonstrations, strokes
from pentimento.contracts.images import encode_png
from pentimento.contracts.schema import TableContract, arrow_schema, row_faults

NAN, INF = float("nan"), float("inf")
Row = dict[str, Any]


def png(*shape: int) -> dict[str, Any]:
    return {"bytes": encode_png(np.zeros(shape, np.uint8)), "path": None}


def point(row: Row, index: int, component: int, value: float) -> None:
    row["path"][index][component] = value


def fault(damage: Callable[[Row], Any], contract: TableContract = strokes.CONTRACT) -> str | None:
    example = strokes.example_table if contract is strokes.CONTRACT else demonstrations.example_table
    rows = example(2).to_pylist()
    damage(rows[1])
    faults = row_faults(pa.Table.from_pylist(rows, schema=arrow_schema(contract)), contract)
    assert faults[0] is None
    return faults[1]


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda r: r.update(tool=None), "tool is null"),
        (lambda r: r.update(order=None), "order is null"),
        (lambda r: r.update(path=None), "path is null"),
        (lambda r: r.update(path=[]), "path is empty"),
        (lambda r: r.update(path=[r["path"][0], None]), "path has a null point"),
        (lambda r: point(r, 3, 1, NAN), "path has a NaN or infinite number"),
        (lambda r: point(r, 3, 4, INF), "path has a NaN or infinite number"),
        (lambda r: point(r, 0, 0, NAN), "path has times at some points only"),
        (lambda r: point(r, 3, 0, -9.0), "path has times that run backwards"),
        (lambda r: r.update(window_m=[0.1, 0.0, 0.0, 0.1]), "window_m is not x_min < x_max"),
        (lambda r: r.update(window_m=[0.0, 0.0, 0.1, NAN]), "window_m is not x_min < x_max"),
        (lambda r: r.update(window_m=[0.0, 0.0, 1.0, 0.1]), "pixels that are not square"),
        (lambda r: r.update(after={"bytes": b"\x89PNG", "path": None}), "after is not a readable PNG"),
        (
            lambda r: r.update(after={"bytes": r["after"]["bytes"][:-60], "path": None}),
            "after is not a readable",
        ),
        (lambda r: r.update(before={"bytes": None, "path": "x.png"}), "before has no image bytes"),
        (lambda r: r.update(before=png(28, 40, 3)), "before, after differ in size"),
        (lambda r: r.update(encoding="rgb"), "encoding is none of srgb, ink"),
        (lambda r: r.update(gain=INF), "gain is infinite"),
    ],
)
def test_a_bad_row_says_why(damage: Callable[[Row], Any], says: str) -> None:
    reason = fault(damage)
    assert reason is not None and says in reason


@pytest.mark.parametrize(
    "damage",
    [
        lambda r: [point(r, i, 0, NAN) for i in range(32)],  # no time was recorded
        lambda r: r.update(gain=NAN, since_reload=None, color_srgb=None, measured_path=None, frame=None),
        lambda r: r.update(before=png(56, 80), after=png(56, 80)),  # grey
    ],
)
def test_unknown_is_allowed_where_the_contract_says_so(damage: Callable[[Row], Any]) -> None:
    assert fault(damage) is None


def test_demonstrations_need_places_but_neither_height_nor_time_nor_pressure() -> None:
    assert fault(lambda r: r.update(points=[[NAN, 0.0, 0.0, NAN, NAN]]), demonstrations.CONTRACT) is None
    assert fault(lambda r: r.update(points=[[0.0, NAN, 0.0, 0.0, 1.0]]), demonstrations.CONTRACT) is not None

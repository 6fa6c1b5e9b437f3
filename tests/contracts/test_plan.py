import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from pentimento.contracts.errors import ContractError
from pentimento.contracts.plan import Plan, PlanHeader, PlannedStroke, read_plan, write_plan


def example() -> Plan:
    rng = np.random.default_rng(0)
    header = PlanHeader("round_brush", rng.random((3, 3)), (0.3, 0.2), "sha256:abc")
    return Plan(header, tuple(PlannedStroke(rng.random((n, 5)), rng.random(3), n == 4) for n in (4, 1, 32)))


def test_round_trip_is_exact(tmp_path: Path) -> None:
    plan = example()
    write_plan(tmp_path / "plan.jsonl", plan)
    again = read_plan(tmp_path / "plan.jsonl")
    assert (again.header.tool, again.header.canvas_size_m, again.header.envelope) == (
        "round_brush",
        (0.3, 0.2),
        "sha256:abc",
    )
    assert_array_equal(again.header.palette_srgb, plan.header.palette_srgb)
    for before, after in zip(plan.strokes, again.strokes, strict=True):
        assert_array_equal(after.path, before.path)
        assert_array_equal(after.color_srgb, before.color_srgb)
        assert after.dip is before.dip


def test_one_line_a_stroke_that_any_json_reader_reads(tmp_path: Path) -> None:
    write_plan(tmp_path / "plan.jsonl", example())
    lines = [json.loads(line) for line in (tmp_path / "plan.jsonl").read_text().splitlines()]
    assert len(lines) == 4
    assert lines[0]["strokes"] == 3 and "t_s, x_m" in lines[0]["units"]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_nan_is_not_written_and_the_old_plan_stays(tmp_path: Path, bad: float) -> None:
    plan, file = example(), tmp_path / "plan.jsonl"
    write_plan(file, plan)
    old = file.read_bytes()
    path = plan.strokes[1].path.copy()
    path[0, 0] = bad
    with pytest.raises(ContractError, match="Stroke 1 of the plan, path has a NaN or infinite"):
        write_plan(file, replace(plan, strokes=(plan.strokes[0], replace(plan.strokes[1], path=path))))
    assert file.read_bytes() == old


def test_colours_of_0_to_255_are_refused(tmp_path: Path) -> None:
    stroke = replace(example().strokes[0], color_srgb=np.array([255.0, 0, 0]))
    with pytest.raises(ContractError, match="divide 8-bit sRGB by 255"):
        write_plan(tmp_path / "p", replace(example(), strokes=(stroke,)))


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda lines: lines[:-1], "promises 3 strokes and holds 2; it was cut off"),
        (lambda lines: [*lines[:-1], lines[-1][:40]], "line 4 is not JSON"),
        (lambda lines: lines[1:], "not a plan of schema"),
        (lambda lines: [], "is empty"),
        (lambda lines: [lines[0].replace('"tool"', '"tol"'), *lines[1:]], "line 1 lacks 'tool'"),
        (
            lambda lines: [*lines[:3], '{"path": [[NaN,0,0,0,0]], "color_srgb": [0,0,0], "dip": true}'],
            "line 4, path",
        ),
        (lambda lines: [*lines[:3], '{"path": [[0,0,0]], "color_srgb": [0,0,0], "dip": true}'], "shape"),
        (
            lambda lines: [*lines[:3], '{"path": [[0,0,0,0,0]], "color_srgb": [0,0,0], "dip": 1}'],
            "true or false",
        ),
        (lambda lines: [*lines[:3], "7"], "not a JSON object"),
    ],
)
def test_damaged_plans_are_refused_with_the_place(tmp_path: Path, damage, says: str) -> None:  # type: ignore[no-untyped-def]
    file = tmp_path / "plan.jsonl"
    write_plan(file, example())
    file.write_text("\n".join(damage(file.read_text().splitlines())))
    with pytest.raises(ContractError, match=says):
        read_plan(file)


def test_a_missing_plan_is_named(tmp_path: Path) -> None:
    with pytest.raises(ContractError, match="cannot be read"):
        read_plan(tmp_path / "none.jsonl")

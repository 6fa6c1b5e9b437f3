import math
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pentimento.contracts import strokes
from pentimento.contracts.covariates import (
    CELL_M,
    Memory,
    StrokeEvent,
    advance,
    covariates,
    covariates_and_advance,
    drawn_length_m,
    fresh_memory,
    new_sheet,
    pickup_step,
    wet_age_s,
    without_canvas,
)
from pentimento.contracts.errors import ContractError

SIZE = (0.30, 0.20)
RED = np.array([1.0, 0.0, 0.0])


def line(x0: float, y0: float, x1: float, y1: float, z: float = -0.001, duration_s: float = 0.0) -> np.ndarray:
    s = np.linspace(0, 1, 32)
    return np.column_stack(
        [duration_s * s, x0 + (x1 - x0) * s, y0 + (y1 - y0) * s, np.full_like(s, z), np.zeros_like(s)]
    )


def event(path: np.ndarray, t_start_s: float = 0.0, dip: bool = False) -> StrokeEvent:
    return StrokeEvent(path, t_start_s, dip, RED)


def copied(memory: Memory) -> dict[str, object]:
    values = {f.name: getattr(memory, f.name) for f in fields(memory)}
    return {k: v.copy() if isinstance(v, np.ndarray) else v for k, v in values.items()}


def test_names_are_columns_of_the_strokes_contract() -> None:
    values = covariates(fresh_memory(SIZE), event(line(0.1, 0.1, 0.15, 0.1)))
    assert all(strokes.CONTRACT.column(name) is not None for name in values)


def test_covariates_and_advance_equals_both_calls() -> None:
    memory = fresh_memory(SIZE)
    for index in range(3):
        stroke = event(line(0.05, 0.05 + 0.001 * index, 0.10, 0.05), t_start_s=10.0 * index, dip=index == 1)
        seen, after = covariates_and_advance(memory, stroke)
        assert repr(seen) == repr(covariates(memory, stroke))  # NaN is not equal to itself
        assert repr(copied(after)) == repr(copied(advance(memory, stroke)))
        memory = after


def test_without_a_canvas_all_but_wet_ages_is_told() -> None:
    memory, blind = fresh_memory(SIZE), without_canvas(fresh_memory(SIZE))
    for index in range(3):
        stroke = event(line(0.05, 0.05, 0.10, 0.05), t_start_s=10.0 * index)
        seen, guess = covariates(memory, stroke), covariates(blind, stroke)
        assert math.isnan(guess.pop("wet_age_s"))
        assert repr(guess) == repr({name: v for name, v in seen.items() if name != "wet_age_s"})
        memory, blind = advance(memory, stroke), advance(blind, stroke)


def test_counting_strokes_dips_and_length() -> None:
    memory, seen = fresh_memory(SIZE, tool_age_m=1.0), []
    for index in range(5):
        stroke = event(line(0.05, 0.05, 0.10, 0.05), t_start_s=10.0 * index, dip=index in (0, 3))
        seen.append(covariates(memory, stroke))
        memory = advance(memory, stroke)
    assert [row["since_reload"] for row in seen] == [0, 1, 2, 0, 1]
    assert [row["reload_id"] for row in seen] == [1, 1, 1, 2, 2]
    np.testing.assert_allclose([row["ink_since_reload_m"] for row in seen], [0, 0.05, 0.10, 0, 0.05], atol=1e-12)
    np.testing.assert_allclose([row["tool_age_m"] for row in seen], 1 + 0.05 * np.arange(5))
    assert math.isnan(seen[0]["wet_age_s"])
    np.testing.assert_allclose([row["wet_age_s"] for row in seen[1:]], 10.0)


def test_previous_colour_is_unknown_at_first_and_then_the_last() -> None:
    memory, stroke = fresh_memory(SIZE), event(line(0.1, 0.1, 0.2, 0.1))
    assert np.isnan(covariates(memory, stroke)["previous_color_srgb"]).all()
    assert covariates(advance(memory, stroke), stroke)["previous_color_srgb"] == [1.0, 0.0, 0.0]


def test_advance_is_pure() -> None:
    memory = advance(fresh_memory(SIZE), event(line(0.1, 0.1, 0.2, 0.1)))
    before = copied(memory)
    advance(memory, event(line(0.1, 0.1, 0.2, 0.15), 5.0, dip=True))
    for name, value in copied(memory).items():
        np.testing.assert_array_equal(value, before[name])


@given(st.lists(st.tuples(st.floats(0.02, 0.28), st.floats(0.02, 0.18), st.booleans()), min_size=1, max_size=8))
def test_length_since_the_dips_adds_up_to_the_tool_age(places: list[tuple[float, float, bool]]) -> None:
    memory, x0, y0, total, since = fresh_memory(SIZE), 0.15, 0.1, 0.0, 0.0
    for t_s, (x, y, dip) in enumerate(places):
        memory = advance(memory, event(line(x0, y0, x, y), float(t_s), dip))
        length = math.hypot(x - x0, y - y0)
        total, since = total + length, (0.0 if dip else since) + length
        x0, y0 = x, y
    assert memory.tool_age_m == pytest.approx(total, abs=1e-9)
    assert memory.ink_since_reload_m == pytest.approx(since, abs=1e-9)


def test_only_contact_draws() -> None:
    assert drawn_length_m(line(0.1, 0.1, 0.2, 0.1, z=0.01)) == 0.0
    assert drawn_length_m(line(0.1, 0.1, 0.2, 0.1, z=0.0)) == pytest.approx(0.1)  # light contact: a marker
    landing = line(0.1, 0.1, 0.2, 0.1)
    landing[:, 3] = np.linspace(0.003, -0.001, 32)  # z crosses 0 after three quarters
    assert drawn_length_m(landing) == pytest.approx(0.025)
    lifted = advance(fresh_memory(SIZE), event(line(0.1, 0.1, 0.2, 0.1, z=0.01)))
    assert not lifted.ink.any()


def test_wet_age_is_that_of_the_paint_underneath() -> None:
    memory = advance(fresh_memory(SIZE), event(line(0.05, 0.10, 0.15, 0.10), 100.0))
    across = line(0.10, 0.05, 0.10, 0.15)
    assert wet_age_s(memory, across, 130.0) == pytest.approx(30.0)
    assert math.isnan(wet_age_s(memory, line(0.05, 0.15, 0.15, 0.15), 130.0))
    repainted = advance(memory, event(line(0.05, 0.10, 0.15, 0.10), 120.0))
    assert wet_age_s(repainted, across, 130.0) == pytest.approx(10.0)


def test_wet_age_is_a_median_by_ink() -> None:
    # Two thirds of the place were painted at 10 s, one third at 40 s: the median is the older age.
    memory = advance(fresh_memory(SIZE), event(line(0.03, 0.10, 0.08, 0.10), 10.0))
    memory = advance(memory, event(line(0.10, 0.10, 0.12, 0.10), 40.0))
    assert wet_age_s(memory, line(0.03, 0.10, 0.12, 0.10), 50.0) == pytest.approx(40.0)


def test_time_of_painting_runs_along_the_stroke() -> None:
    memory = advance(fresh_memory(SIZE), event(line(0.05, 0.10, 0.15, 0.10, duration_s=10.0), 0.0))
    early = wet_age_s(memory, line(0.06, 0.08, 0.06, 0.12), 20.0)
    late = wet_age_s(memory, line(0.14, 0.08, 0.14, 0.12), 20.0)
    assert early == pytest.approx(19.0, abs=0.4) and late == pytest.approx(11.0, abs=0.4)


def test_unknown_times_count_as_the_start() -> None:
    path = line(0.05, 0.10, 0.15, 0.10)
    path[:, 0] = np.nan
    memory = advance(fresh_memory(SIZE), event(path, 7.0))
    assert wet_age_s(memory, path, 10.0) == pytest.approx(3.0)


@pytest.mark.parametrize("width_m", [0.003, 0.006, 0.012])
def test_ink_on_the_canvas_is_the_area_of_the_mark(width_m: float) -> None:
    length_m = 0.1
    memory = advance(fresh_memory(SIZE, width_m), event(line(0.1, 0.1, 0.1 + length_m, 0.1)))
    area_m2 = memory.ink.sum() * CELL_M**2
    assert area_m2 == pytest.approx(length_m * width_m + math.pi * width_m**2 / 4, rel=0.15)
    assert (np.isnan(memory.painted_at_s) == (memory.ink == 0)).all()


def test_row_0_is_the_top_of_the_canvas() -> None:
    memory = advance(fresh_memory(SIZE), event(line(0.1, 0.195, 0.2, 0.195)))
    assert np.nonzero(memory.ink)[0].max() < 6


def test_paths_beyond_the_canvas_are_cut_and_dabs_are_drawn() -> None:
    memory = advance(fresh_memory(SIZE), event(line(-0.1, 0.1, 0.4, 0.1)))
    assert memory.ink_since_reload_m == pytest.approx(0.5)
    dab = advance(fresh_memory(SIZE), event(line(0.1, 0.1, 0.1, 0.1)))
    assert dab.ink.sum() > 1 and dab.tool_age_m == 0.0


def test_a_new_sheet_is_blank_but_the_tool_is_the_same() -> None:
    memory = new_sheet(advance(fresh_memory(SIZE), event(line(0.1, 0.1, 0.2, 0.1), dip=True)))
    assert not memory.ink.any() and np.isnan(memory.painted_at_s).all()
    assert (memory.since_reload, memory.reload_id, memory.tool_age_m) == (1, 1, pytest.approx(0.1))


def test_pickup_is_linear_along_a_stroke_and_mixes_by_amount() -> None:
    blue, yellow, own = np.array([0.0, 0.0, 1.0]), np.array([1.0, 1.0, 0.0]), RED
    middle, first = pickup_step(np.zeros(4), 0.4, blue, 0.0, own)
    np.testing.assert_allclose(middle, [0.2, *blue])  # half of it, halfway
    np.testing.assert_allclose(first, [0.4, *(0.4 * blue)])
    middle, second = pickup_step(first, 0.8, yellow, 0.0, own)
    np.testing.assert_allclose(middle, [0.8, *(0.5 * blue + 0.5 * yellow)])
    np.testing.assert_allclose(second[0], 1.2)
    dry, _ = pickup_step(np.zeros(4), 0.8, yellow, 1e9, own)
    assert dry[0] < 1e-3
    nothing, state = pickup_step(np.zeros(4), 0.8, yellow, math.nan, own)
    np.testing.assert_array_equal(nothing, [0.0, *own])
    assert not state.any()


def test_bad_input_raises_contract_error() -> None:
    memory, path = fresh_memory(SIZE), line(0.1, 0.1, 0.2, 0.1)
    with pytest.raises(ContractError, match=r"must be \[N, 5\]"):
        advance(memory, event(path[:, :4]))
    path[3, 1] = np.nan
    with pytest.raises(ContractError, match=r"must be \[N, 5\]"):
        covariates(memory, event(path))
    with pytest.raises(ContractError, match="start time is nan"):
        advance(memory, event(line(0.1, 0.1, 0.2, 0.1), math.nan))
    with pytest.raises(ContractError, match="must be above 0"):
        fresh_memory((0.3, 0.0))

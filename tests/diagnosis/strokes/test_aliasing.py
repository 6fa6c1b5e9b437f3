"""Aliasing: closed forms on linear models, and dependence on the design only."""

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.experiment_design import (
    Aliasing,
    Columns,
    aliased_pairs,
    aliasing,
    aliasing_in_short,
    aliasing_sentences,
    information,
)
from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.strokes.aliasing import aliasing_of, design
from pentimento.diagnosis.strokes.fit import first_model
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.dynamics.strokes.mechanisms import VOCABULARY


def statistics_of(jacobian: np.ndarray) -> Statistics:
    """Of a linear model, [n, pixels, P]."""
    n, _, size = jacobian.shape
    return Statistics(np.einsum("nxp,nxq->npq", jacobian, jacobian), np.zeros((n, size)), np.zeros(n))


@pytest.fixture
def jacobian() -> np.ndarray:
    return np.random.default_rng(0).normal(size=(30, 8, 6))


COLUMNS = Columns(np.array([0, 1]), {"a": np.array([2]), "b": np.array([3]), "c": np.array([4, 5])})


def test_aliasing_is_the_cosine_of_projected_jacobians(jacobian: np.ndarray) -> None:
    flat = jacobian.reshape(-1, 6)
    left = flat - flat[:, :2] @ np.linalg.lstsq(flat[:, :2], flat, rcond=None)[0]
    a, b = left[:, 2], left[:, 3]
    expected = abs(a @ b) / np.linalg.norm(a) / np.linalg.norm(b)
    found = aliasing(statistics_of(jacobian), COLUMNS)
    assert found.of("a", "b") == pytest.approx(expected, abs=1e-6)
    np.testing.assert_allclose(found.cosine, found.cosine.T)


def test_aliasing_depends_on_the_span_of_quantities_only(jacobian: np.ndarray) -> None:
    """The largest canonical correlation does not ask in which quantities a cause is written."""
    found = aliasing(statistics_of(jacobian), COLUMNS)
    turned = jacobian.copy()
    turned[..., 4:] = jacobian[..., 4:] @ np.array([[3.0, 1.0], [-2.0, 0.5]])
    again = aliasing(statistics_of(turned), COLUMNS)
    assert again.of("a", "c") == pytest.approx(found.of("a", "c"), abs=1e-6)
    assert (
        found.of("a", "c")
        >= abs(
            aliasing(statistics_of(jacobian), Columns(COLUMNS.nuisances, {"a": np.array([2]), "c": np.array([4])})).of(
                "a", "c"
            )
        )
        - 1e-9
    )


def test_cause_within_the_nuisances_has_no_aliasing(jacobian: np.ndarray) -> None:
    jacobian[..., 3] = jacobian[..., 0] - 2 * jacobian[..., 1]
    found = aliasing(statistics_of(jacobian), COLUMNS)
    assert np.isnan(found.of("a", "b")) and not np.isnan(found.of("a", "c"))
    assert any("b has no effect" in line for line in aliasing_sentences(found))


def test_sentences_name_aliased_pairs_and_hidden_causes(jacobian: np.ndarray) -> None:
    jacobian[..., 3] = -4 * jacobian[..., 2] + 0.01 * jacobian[..., 3] + jacobian[..., 1]
    found = aliasing(statistics_of(jacobian), COLUMNS)
    assert found.of("a", "b") > 0.999
    assert aliasing_sentences(found)[0].startswith("a and b are aliased (1.00)")


def test_short_form_lists_the_closest_pairs_first() -> None:
    cosine = np.array([[1, 0.91, 0.2, np.nan], [0.91, 1, 0.97, np.nan], [0.2, 0.97, 1, np.nan], [np.nan] * 4])
    found = Aliasing(("a", "b", "c", "d"), cosine)
    assert aliasing_in_short(found) == "b ~ c .97, a ~ b .91, d not identifiable"
    assert aliasing_in_short(found, 0.99) == "no two causes above .99 (b ~ c .97), d not identifiable"
    assert found.largest == 0.97
    alone = Aliasing(("a",), np.eye(1))
    assert alone.largest == 0.0 and aliasing_in_short(alone) == "no two causes above .90"


def test_information_is_reduced_by_nuisances_only(jacobian: np.ndarray) -> None:
    total = statistics_of(jacobian).curvature.sum(0)
    interest = np.array([2, 3])
    less = np.linalg.eigvalsh(total[np.ix_(interest, interest)] - information(total, np.array([0, 1]), interest))
    assert less.min() > -1e-9 and less.max() > 0


def test_rivals_and_aliased_causes_are_paired_once() -> None:
    cosine = np.array([[1, 0.95, 0.2], [0.95, 1, 0.1], [0.2, 0.1, 1]])
    found = Aliasing(("a", "b", "c"), cosine)
    assert aliased_pairs(found, {"a": ("c",), "b": ()}) == [("a", "c"), ("a", "b")]


def commands(headings: np.ndarray, ink_m: np.ndarray, places_m: np.ndarray) -> pa.Table:
    """Straight strokes without a photograph."""
    along = np.linspace(0, 0.03, 12)
    rows = []
    for order, (heading, ink, place) in enumerate(zip(headings, ink_m, places_m, strict=True)):
        xy = place + along[:, None] * (np.cos(heading), np.sin(heading))
        path = np.column_stack([along / 0.05, xy, np.full(12, -0.001), np.zeros(12)])
        rows.append(
            {
                "session": "planned", "order": order, "action_id": order, "tool": "round_brush", "path": path.tolist(),
                "color_srgb": [0.1, 0.1, 0.1], "ink_since_reload_m": float(ink), "tool_age_m": 0.03 * order,
            }
        )  # fmt: skip
    known = {field.name: field.type for field in example_table(1).schema}
    return pa.Table.from_pylist(rows, schema=pa.schema([(name, known[name]) for name in rows[0]]))


def test_raster_design_aliases_ink_and_tilt() -> None:
    """With a dip per row, ink goes with x, as the press of a tilted canvas does; in random order it does not."""
    rng = np.random.default_rng(1)
    row, column = np.divmod(np.arange(40), 8)
    raster = np.column_stack([0.03 + 0.035 * column, 0.03 + 0.035 * row])
    ordered = design(commands(np.zeros(40), 0.03 * column, raster))
    mixed = design(commands(rng.uniform(-3, 3, 40), rng.permutation(0.03 * column), rng.permutation(raster)))
    model = first_model(load_measured(example_table(6)))
    found = [aliasing_of(model, strokes, VOCABULARY) for strokes in (ordered, mixed)]
    assert found[0].of("ink_depletion", "canvas_tilt") > 0.9 > found[1].of("ink_depletion", "canvas_tilt") + 0.2
    # Of one heading, backlash is an offset, and perhaps no more than the base's own shifts can be.
    ordered_too, mixed_too = (one.of("backlash", "path_offset") for one in found)
    assert np.isnan(ordered_too) or ordered_too > 0.99
    assert mixed_too < 0.8

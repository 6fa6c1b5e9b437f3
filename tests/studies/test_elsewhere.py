"""Further tables of a blind world."""

from functools import cache

import numpy as np
import pyarrow as pa
import pytest

from studies.blind.collect import as_table, record_world
from studies.blind.decoys import draw_decoys
from studies.blind.design import view_of
from studies.blind.elsewhere import COLUMNS, commands_from, shifted_table, with_doubled, with_shuffled
from studies.blind.make import Truth, commands_of
from studies.blind.strength import Strength, StrengthError
from studies.blind.worlds import Sketch, sketch_world


def world(strength: float) -> tuple[Sketch, Truth]:
    sketch = sketch_world("one", 3, "ink_depletion", "round_brush")
    found = Strength(strength, 0.4, 0.02)
    return sketch, Truth("one", 3, "round_brush", sketch.causes, None, sketch.q, (found,), sketch.misshaped)


@cache
def table() -> pa.Table:
    """The first strokes of its sheet."""
    sketch, _ = world(0.4)
    view = view_of(sketch.tool, fine=False)
    some = commands_of(sketch, view)[:8]
    made = record_world(sketch.with_strengths((0.4,)), 3, sketch.tool, sketch.palette_srgb, some, view)
    return as_table(made, draw_decoys(8, 3))


@pytest.mark.parametrize("cause", sorted(COLUMNS))
def test_shuffling_deals_out_one_covariate_and_leaves_all_else(cause: str) -> None:
    shuffled = with_shuffled(table(), cause, seed=1)
    dealt = [name for name in COLUMNS[cause] if name in table().column_names]
    assert dealt and shuffled.schema == table().schema
    for name in table().column_names:
        before, after = (str(t[name].to_pylist()) for t in (table(), shuffled))
        assert before == after or name in dealt
    rows, mixed = (sorted(map(str, t.select(dealt).to_pylist())) for t in (table(), shuffled))
    assert rows == mixed  # the columns of one row stay together
    if len({str(row) for row in table().select(dealt).to_pylist()}) > 1:
        assert str(table().select(dealt).to_pylist()) != str(shuffled.select(dealt).to_pylist())


def test_proposed_actions_become_the_same_commands() -> None:
    sketch, _ = world(0.4)
    view = view_of(sketch.tool, fine=False)
    rows = table().to_pylist()
    proposed = pa.table(
        {
            "path": [row["path"] for row in rows],
            "window_m": [row["window_m"] for row in rows],
            "color_srgb": [row["color_srgb"] for row in rows],
            "reload": [row["since_reload"] == 0 for row in rows],
            "wait_s": [float(10 * number) for number in range(len(rows))],
        }
    )
    made = commands_from(proposed, sketch, view, sheet=6, first_action=120)
    original = commands_of(sketch, view)[:8]
    for number, (one, same) in enumerate(zip(made, original, strict=True)):
        assert (one.sheet, one.action_id) == (6, 120 + number)
        np.testing.assert_allclose(one.path, same.path, atol=1e-6)
        assert one.window_px == same.window_px
        assert one.color_srgb in [tuple(paint) for paint in sketch.palette_srgb.tolist()]
        np.testing.assert_allclose(one.color_srgb, rows[number]["color_srgb"], atol=1e-3)
    assert [one.wait_s for one in made] == [10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 1.0]


def test_what_cannot_be_doubled_is_refused() -> None:
    sketch, truth = world(8.0)
    with pytest.raises(StrengthError, match="ink_depletion cannot be doubled"):
        with_doubled(sketch, truth, table())


def test_the_shifted_session_presses_deeper_faster_and_repeats() -> None:
    sketch, truth = world(0.4)
    made = shifted_table(sketch, truth)
    light, deep = sketch.tool.press_range_m
    press = [-point[3] for path in made["path"].to_pylist() for point in path]
    assert min(press) > 0.9 * (light + deep) / 2 and max(press) < 1.1 * deep
    _, times = np.unique(made["action_id"].to_numpy(), return_counts=True)
    assert (times == 2).sum() == 12

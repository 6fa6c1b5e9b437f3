"""Simulated worlds of strokes: seeds, designs, effect energies and the other tables of a world."""

import hashlib
import json
from dataclasses import asdict, fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.studio.strokes.world import Effects
from studies.blind.decoys import COLUMNS, draw_decoys
from studies.blind.one_world import with_shuffled
from studies.blind.series import COLUMNS as CAUSE_COLUMNS
from studies.blind.strokes.collect import Recording, as_table, record_world
from studies.blind.strokes.design import REPEATED, SINGLES, TIMES, Command, randomised, raster, view_of
from studies.blind.strokes.make import commands_of, make_world
from studies.blind.strokes.other_tables import commands_from, shifted_table, with_doubled
from studies.blind.strokes.paint_context import Disturbance, Mode, PaintContext
from studies.blind.strokes.strength import Trial, disturbances, measure
from studies.blind.strokes.worlds import CAUSES, OUTSIDE, Outside, Sketch, sketch_world
from studies.blind.truth import Strength, StrengthError, Truth, write_world

ROWS = SINGLES + REPEATED * TIMES
LINE = np.column_stack([np.linspace(0, 0.5, 8), np.linspace(0.05, 0.08, 8), *np.tile([[0.1], [-4e-4], [0]], 8)])


def commands(sketch: Sketch) -> list[Command]:
    return commands_of(sketch, view_of(sketch.tool, fine=False))


def record(sketch: Sketch, some: list[Command], strengths: tuple[float, ...] = (), realisation: int = 0) -> Recording:
    view = view_of(sketch.tool, fine=False)
    world = sketch.with_strengths(strengths)
    return record_world(
        world,
        sketch.seed,
        sketch.tool,
        palette_srgb=sketch.palette_srgb,
        commands=some,
        view=view,
        realisation=realisation,
    )


@cache
def few_trial() -> Trial:
    """The first strokes of a marker's design, in two realisations without the two effects that it can have."""
    sketch = replace(sketch_world("one", 3, tool="marker"), causes=("path_offset", "speed_density"), q=(0.2, 0.2))
    some = commands(sketch)[:5]
    quiet = record(sketch, some, (0.0, 0.0), 1), record(sketch, some, (0.0, 0.0), 2)
    return Trial(sketch, some, view_of(sketch.tool, fine=False), None, (0,), quiet)


def test_equal_seeds_give_equal_worlds_and_tables() -> None:
    one, two = (sketch_world("one", 5, tool="marker") for _ in range(2))
    assert one.world == two.world and one.causes == two.causes and one.q == two.q
    tables = [as_table(record(s, commands(s)[:2], (0.7,)), draw_decoys(2, s.seed)) for s in (one, two)]
    assert str(tables[0].to_pylist()) == str(tables[1].to_pylist())  # as text, NaN is NaN
    other = sketch_world("one", 6, tool="marker")
    assert other.world != one.world
    again = as_table(record(other, commands(other)[:2], (0.7,)), draw_decoys(2, 6))
    assert str(again.to_pylist()) != str(tables[0].to_pylist())


def test_world_of_stratum_none_has_no_effects_and_a_valid_table(tmp_path: Path) -> None:
    sketch = sketch_world("none", 4, tool="marker")
    table, truth = make_world(sketch)
    assert set(asdict(sketch.with_strengths(()).effects).values()) == {0.0}
    assert truth.causes == () and truth.strengths == () and truth.wanted_q == () and truth.outside is None
    write_world(tmp_path, table, truth)
    checked = read_table(tmp_path / "table.parquet", CONTRACT)
    assert checked.table.num_rows == ROWS and checked.quarantined == ()
    seal = (tmp_path / "truth.sha256").read_text().strip()
    assert seal == hashlib.sha256((tmp_path / "truth.json").read_bytes()).hexdigest()
    assert json.loads((tmp_path / "truth.json").read_text())["stratum"] == "none"


def test_table_does_not_leak_the_truth() -> None:
    """Columns, metadata, texts and covariates are the same with and without the effect."""
    hidden = sketch_world("one", 3, cause="path_offset", tool="marker")
    blank = replace(hidden, stratum="none", causes=(), q=())
    some = commands(hidden)[:2]
    decoys = draw_decoys(2, 3)
    with_effect = as_table(record(hidden, some, (3.0,)), decoys)
    without = as_table(record(blank, some), decoys)
    assert with_effect.schema.equals(without.schema, check_metadata=True)
    assert not {"measured_path", "force_n"} & set(with_effect.column_names)
    shown = [name for name in without.column_names if name not in ("before", "after")]
    assert str(with_effect.select(shown).to_pylist()) == str(without.select(shown).to_pylist())
    assert not with_effect.select(["after"]).equals(without.select(["after"]))
    texts = json.dumps([row for row in with_effect.drop_columns(["before", "after"]).to_pylist()]).lower()
    assert not any(name in texts for name in ("path_offset", "strength", "truth", "cause", "stratum"))
    assert b"path_offset" not in with_effect.schema.serialize().to_pybytes()


@pytest.mark.parametrize("stratum", ["one", "raster"])
def test_designs_repeat_24_actions_three_times_on_different_sheets(stratum: str) -> None:
    sketch = sketch_world("raster" if stratum == "raster" else "one", 8, tool="round_brush")
    design = commands(sketch)
    times = np.bincount([c.action_id for c in design])
    assert len(design) == ROWS and np.sum(times == 1) == SINGLES and np.sum(times == TIMES) == REPEATED
    for action in np.flatnonzero(times == TIMES):
        same = [c for c in design if c.action_id == action]
        assert len({c.sheet for c in same}) == TIMES  # never over its own paint
        for command in same[1:]:
            assert command.path is same[0].path and command.window_px == same[0].window_px
            assert (command.color_srgb, command.dip, command.wait_s) == (
                same[0].color_srgb, same[0].dip, same[0].wait_s,
            )  # fmt: skip


def test_place_correlates_with_order_only_in_raster_design() -> None:
    sketch = sketch_world("one", 8, tool="round_brush")
    view, size = view_of(sketch.tool, fine=False), sketch.world.paper.size_m

    def correlation(design: list[Command]) -> float:
        """Of the place on the sheet (from its foot to its head) with the order on it."""
        first = [c for c in design if c.sheet == 1]
        y = [c.path[:, 2].mean() for c in first]
        return abs(float(np.corrcoef(y, np.arange(len(first)))[0, 1]))

    assert correlation(randomised(sketch.tool, size, sketch.palette_srgb, view, 8)) < 0.4
    assert correlation(raster(sketch.tool, size, sketch.palette_srgb, view, 8)) > 0.95


def test_single_strokes_cross_wet_paint_and_repeated_strokes_do_not() -> None:
    sketch = sketch_world("none", 2, tool="round_brush")
    design = [c for c in commands(sketch) if c.sheet == 0]
    rows = record(sketch, design).rows
    ages = {c.action_id: row["wet_age_s"] for c, row in zip(design, rows, strict=True)}
    single = [age for action, age in ages.items() if action < SINGLES]
    repeated = [age for action, age in ages.items() if action >= SINGLES]
    assert np.mean(np.isfinite(single)) > 0.3 and not np.isfinite(repeated).any()


def test_flat_tool_without_orientation_width_has_an_isotropic_bundle() -> None:
    sketch = sketch_world("one", 5, "orientation_width", "flat_brush")
    bundle = PaintContext(sketch.with_strengths((0.0,)), 5)._bundle
    for weight in (bundle.short_m, bundle.wetting, np.ones(len(bundle.place))):
        np.testing.assert_allclose(weight @ bundle.place, 0.0, atol=1e-12)
        (aside, skew), (_, ahead) = bundle.place.T @ (weight[:, None] * bundle.place)
        assert aside == pytest.approx(ahead) and skew == pytest.approx(0.0, abs=1e-9)


def test_windows_have_the_wanted_size_and_contain_the_path() -> None:
    sketch = sketch_world("none", 2, tool="flat_brush")
    for fine, size in ((False, {64, 48}), (True, {128, 96})):
        view = view_of(sketch.tool, fine)
        design = randomised(sketch.tool, sketch.world.paper.size_m, sketch.palette_srgb, view, 2)[:3]
        made = record_world(sketch.world, 2, sketch.tool, palette_srgb=sketch.palette_srgb, commands=design, view=view)
        for command, row, after in zip(design, made.rows, made.after, strict=True):
            x_min, y_min, x_max, y_max = row["window_m"]
            assert set(after.shape[:2]) == size
            assert np.all((command.path[:, 1:3] > (x_min, y_min)) & (command.path[:, 1:3] < (x_max, y_max)))


def test_partial_readout_equals_the_whole_frame() -> None:
    world = sketch_world("none", 2, tool="marker").world
    quiet = replace(world, camera=replace(world.camera, full_well=1e12, read_noise=0.0))
    whole, part = PaintContext(quiet, 3), PaintContext(quiet, 3)
    for paint_context in (whole, part):
        paint_context.stroke(LINE)
    part.read_out([220.0, 360.0, 340.0, 410.0])
    one, two = whole.photo().frame[360:410, 220:340], part.photo().frame[360:410, 220:340]
    assert np.ptp(one) > 100  # the stroke is in it
    assert np.max(np.abs(one.astype(int) - two)) <= 1


@pytest.mark.parametrize("cause", ["path_offset", "speed_density"])
def test_energy_increases_with_strength(cause: str) -> None:
    weak, strong = (measure(few_trial(), cause, strength).q for strength in (0.5, 1.5))
    assert 0 < weak < strong


def test_effect_of_strength_zero_has_no_energy() -> None:
    assert measure(few_trial(), "path_offset", 0.0).q == 0.0


def test_base_absorbs_a_constant_amplitude() -> None:
    """An amplitude that varies between strokes is an effect; a constant one is calibrated away."""
    outside = Outside("amplitude", "temperature_c")
    trial = replace(few_trial(), sketch=replace(few_trial().sketch, causes=(), outside=outside, q=(0.2,)))
    column = np.linspace(-1.5, 1.5, len(trial.commands))
    varying = measure(replace(trial, column=column), None, 1.0).q
    constant = measure(replace(trial, column=np.full_like(column, -1.5)), None, 1.0).q
    assert varying > 4 * constant


@cache
def disturbed_photos(disturbance: Disturbance) -> tuple[np.ndarray, np.ndarray]:
    """Photographs of one stroke with the disturbance and of the next one without it."""
    paint_context = PaintContext(sketch_world("none", 2, tool="marker").world, 3)
    paint_context.read_out([220.0, 360.0, 340.0, 410.0])
    paint_context.disturb(disturbance)
    paint_context.stroke(LINE)
    first = paint_context.photo().frame
    paint_context.disturb(Disturbance("width", 0.0))
    paint_context.new_sheet()
    paint_context.stroke(LINE)
    return first, paint_context.photo().frame


@pytest.mark.parametrize("mode", sorted({o.mode for o in OUTSIDE}))
def test_disturbance_changes_only_its_own_stroke(mode: Mode) -> None:
    amount = {"width": 0.5, "amplitude": 0.5, "blur": 2.0}.get(mode, 0.002)
    plain, disturbed = disturbed_photos(Disturbance("width", 0.0)), disturbed_photos(Disturbance(mode, amount))
    moved = [np.abs(a.astype(int) - b).max() for a, b in zip(plain, disturbed, strict=True)]
    assert moved[0] > 30 and moved[0] > 2 * moved[1]


def test_encoders_do_not_measure_a_normal_shift() -> None:
    world = sketch_world("none", 2, tool="marker").world
    plain, shifted = PaintContext(world, 3), PaintContext(world, 3)
    shifted.disturb(Disturbance("normal", 0.003))
    np.testing.assert_allclose(plain.stroke(LINE), shifted.stroke(LINE), atol=1e-12)


def test_disturbance_amounts_increase_with_their_column() -> None:
    column = np.linspace(-2, 2, 9)
    amounts = [d.amount for d in disturbances(Outside("width", "humidity"), column, 1.0)]
    assert np.all(np.diff(amounts) >= 0) and amounts[4] == 0.0
    assert np.all(np.diff([d.amount for d in disturbances(Outside("width", "humidity"), column, 2.0)]) >= 0)


def test_decoys_vary_and_a_lively_decoy_has_no_trend() -> None:
    columns = draw_decoys(ROWS, 1, lively="temperature_c")
    assert set(columns) == set(COLUMNS)
    for seed in range(20):
        for name, values in draw_decoys(ROWS, seed, lively="temperature_c").items():
            assert np.isfinite(values).all() and values.std() > 0
            if name == "temperature_c":
                assert abs(np.corrcoef(values, np.arange(ROWS))[0, 1]) < 0.5


def test_causes_are_the_effects_of_the_studio_and_each_has_a_tool() -> None:
    known = {f.name for f in fields(Effects)}
    assert {cause for causes in CAUSES.values() for cause in causes} == known
    with pytest.raises(ConfigError, match="wet_mixing"):
        sketch_world("one", 1, cause="wet_mixing", tool="marker")
    two = sketch_world("two", 1)
    assert len(set(two.causes)) == 2 == len(two.q)


def world(strength: float) -> tuple[Sketch, Truth]:
    sketch = sketch_world("one", 3, "ink_depletion", "round_brush")
    found = Strength(strength, 0.4, 0.02)
    return sketch, Truth("one", 3, "round_brush", sketch.causes, None, sketch.q, (found,), sketch.misshaped)


@cache
def table() -> pa.Table:
    """The first eight strokes of a world."""
    sketch, _ = world(0.4)
    view = view_of(sketch.tool, fine=False)
    some = commands_of(sketch, view)[:8]
    made = record_world(
        sketch.with_strengths((0.4,)), 3, sketch.tool, palette_srgb=sketch.palette_srgb, commands=some, view=view
    )
    return as_table(made, draw_decoys(8, 3))


@pytest.mark.parametrize("cause", sorted(c for c in CAUSE_COLUMNS if c in CAUSES["round_brush"]))
def test_shuffling_permutes_the_columns_of_one_cause_together(cause: str) -> None:
    shuffled = with_shuffled(table(), cause, seed=1)
    permuted = [name for name in CAUSE_COLUMNS[cause] if name in table().column_names]
    assert permuted and shuffled.schema == table().schema
    for name in table().column_names:
        before, after = (str(t[name].to_pylist()) for t in (table(), shuffled))
        assert before == after or name in permuted
    rows, mixed = (sorted(map(str, t.select(permuted).to_pylist())) for t in (table(), shuffled))
    assert rows == mixed  # the columns of one row stay together
    if len({str(row) for row in table().select(permuted).to_pylist()}) > 1:
        assert str(table().select(permuted).to_pylist()) != str(shuffled.select(permuted).to_pylist())


def test_proposed_actions_round_trip_to_commands() -> None:
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


def test_doubling_beyond_the_max_strength_is_an_error() -> None:
    sketch, truth = world(8.0)
    with pytest.raises(StrengthError, match="ink_depletion cannot be doubled"):
        with_doubled(sketch, truth, table())


def test_out_of_distribution_table_is_pressed_deeper_and_repeats_actions() -> None:
    sketch, truth = world(0.4)
    made = shifted_table(sketch, truth)
    light, deep = sketch.tool.press_range_m
    press = [-point[3] for path in made["path"].to_pylist() for point in path]
    assert min(press) > 0.9 * (light + deep) / 2 and max(press) < 1.1 * deep
    _, times = np.unique(made["action_id"].to_numpy(), return_counts=True)
    assert (times == 2).sum() == 12

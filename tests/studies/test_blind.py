"""Blind worlds: drawn by seed, hidden well, and as strong as they are said to be."""

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
from pentimento.studio.world import Effects
from studies.blind.collect import Recording, as_table, record_world
from studies.blind.decoys import COLUMNS, draw_decoys
from studies.blind.design import REPEATED, SINGLES, TIMES, Command, randomised, raster, view_of
from studies.blind.make import Truth, commands_of, make_world, write_world
from studies.blind.paint_context import Disturbance, Mode, PaintContext
from studies.blind.strength import Strength, Trial, disturbances, measure
from studies.blind.worlds import CAUSES, OUTSIDE, Outside, Sketch, sketch_world

ROWS = SINGLES + REPEATED * TIMES
LINE = np.column_stack([np.linspace(0, 0.5, 8), np.linspace(0.05, 0.08, 8), *np.tile([[0.1], [-4e-4], [0]], 8)])


def commands(sketch: Sketch) -> list[Command]:
    return commands_of(sketch, view_of(sketch.tool, fine=False))


def record(sketch: Sketch, some: list[Command], strengths: tuple[float, ...] = (), realisation: int = 0) -> Recording:
    view = view_of(sketch.tool, fine=False)
    world = sketch.with_strengths(strengths)
    return record_world(world, sketch.seed, sketch.tool, sketch.palette_srgb, some, view, realisation=realisation)


@cache
def few_trial() -> Trial:
    """The first strokes of a marker's design, in two realisations without the two effects that it can have."""
    sketch = replace(sketch_world("one", 3, tool="marker"), causes=("path_offset", "speed_density"), q=(0.2, 0.2))
    some = commands(sketch)[:5]
    quiet = record(sketch, some, (0.0, 0.0), 1), record(sketch, some, (0.0, 0.0), 2)
    return Trial(sketch, some, view_of(sketch.tool, fine=False), None, (0,), quiet)


def test_seed_decides_everything() -> None:
    one, two = (sketch_world("one", 5, tool="marker") for _ in range(2))
    assert one.world == two.world and one.causes == two.causes and one.q == two.q
    tables = [as_table(record(s, commands(s)[:2], (0.7,)), draw_decoys(2, s.seed)) for s in (one, two)]
    assert str(tables[0].to_pylist()) == str(tables[1].to_pylist())  # as text, NaN is NaN
    other = sketch_world("one", 6, tool="marker")
    assert other.world != one.world
    again = as_table(record(other, commands(other)[:2], (0.7,)), draw_decoys(2, 6))
    assert str(again.to_pylist()) != str(tables[0].to_pylist())


def test_a_world_of_stratum_none_hides_nothing(tmp_path: Path) -> None:
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


def test_the_table_tells_nothing_of_the_truth() -> None:
    """Hidden or not, the same columns, metadata, texts and covariates stand beside the images."""
    hidden = sketch_world("one", 3, cause="path_offset", tool="marker")
    blank = replace(hidden, stratum="none", causes=(), q=())
    some = commands(hidden)[:2]
    decoys = draw_decoys(2, 3)
    with_effect = as_table(record(hidden, some, (3.0,)), decoys)
    without = as_table(record(blank, some), decoys)
    assert with_effect.schema.equals(without.schema, check_metadata=True)
    told = [name for name in without.column_names if name not in ("before", "after", "measured_path")]
    assert str(with_effect.select(told).to_pylist()) == str(without.select(told).to_pylist())
    assert not with_effect.select(["after"]).equals(without.select(["after"]))
    texts = json.dumps([row for row in with_effect.drop_columns(["before", "after"]).to_pylist()]).lower()
    assert not any(name in texts for name in ("path_offset", "strength", "truth", "cause", "stratum"))
    assert b"path_offset" not in with_effect.schema.serialize().to_pybytes()


@pytest.mark.parametrize("stratum", ["one", "raster"])
def test_designs_repeat_24_actions_three_times(stratum: str) -> None:
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


def test_randomised_design_is_not_confounded_and_a_raster_is() -> None:
    sketch = sketch_world("one", 8, tool="round_brush")
    view, size = view_of(sketch.tool, fine=False), sketch.world.paper.size_m

    def correlation(design: list[Command]) -> float:
        """Of the place on the sheet (from its foot to its head) with the order on it."""
        first = [c for c in design if c.sheet == 1]
        y = [c.path[:, 2].mean() for c in first]
        return abs(float(np.corrcoef(y, np.arange(len(first)))[0, 1]))

    assert correlation(randomised(sketch.tool, size, sketch.palette_srgb, view, 8)) < 0.4
    assert correlation(raster(sketch.tool, size, sketch.palette_srgb, view, 8)) > 0.95


def test_strokes_cross_wet_paint_but_repeated_ones_do_not() -> None:
    sketch = sketch_world("none", 2, tool="round_brush")
    design = [c for c in commands(sketch) if c.sheet == 0]
    rows = record(sketch, design).rows
    ages = {c.action_id: row["wet_age_s"] for c, row in zip(design, rows, strict=True)}
    single = [age for action, age in ages.items() if action < SINGLES]
    repeated = [age for action, age in ages.items() if action >= SINGLES]
    assert np.mean(np.isfinite(single)) > 0.3 and not np.isfinite(repeated).any()


def test_a_flat_tool_of_no_orientation_reaches_as_far_aside_as_ahead() -> None:
    sketch = sketch_world("one", 5, "orientation_width", "flat_brush")
    bundle = PaintContext(sketch.with_strengths((0.0,)), 5)._bundle
    for weight in (bundle.short_m, bundle.wetting, np.ones(len(bundle.place))):
        np.testing.assert_allclose(weight @ bundle.place, 0.0, atol=1e-12)
        (aside, skew), (_, ahead) = bundle.place.T @ (weight[:, None] * bundle.place)
        assert aside == pytest.approx(ahead) and skew == pytest.approx(0.0, abs=1e-9)


def test_windows_are_small_and_hold_the_whole_path() -> None:
    sketch = sketch_world("none", 2, tool="flat_brush")
    for fine, size in ((False, {64, 48}), (True, {128, 96})):
        view = view_of(sketch.tool, fine)
        design = randomised(sketch.tool, sketch.world.paper.size_m, sketch.palette_srgb, view, 2)[:3]
        made = record_world(sketch.world, 2, sketch.tool, sketch.palette_srgb, design, view)
        for command, row, after in zip(design, made.rows, made.after, strict=True):
            x_min, y_min, x_max, y_max = row["window_m"]
            assert set(after.shape[:2]) == size
            assert np.all((command.path[:, 1:3] > (x_min, y_min)) & (command.path[:, 1:3] < (x_max, y_max)))


def test_reading_out_a_part_shows_what_the_whole_frame_shows() -> None:
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
def test_q_grows_with_strength(cause: str) -> None:
    weak, strong = (measure(few_trial(), cause, strength).q for strength in (0.5, 1.5))
    assert 0 < weak < strong


def test_an_effect_of_no_strength_has_no_q() -> None:
    assert measure(few_trial(), "path_offset", 0.0).q == 0.0


def test_the_base_absorbs_a_constant_amplitude() -> None:
    """An amplitude that changes from stroke to stroke is an effect; the same for all strokes is a calibration."""
    outside = Outside("amplitude", "temperature_c")
    trial = replace(few_trial(), sketch=replace(few_trial().sketch, causes=(), outside=outside, q=(0.2,)))
    column = np.linspace(-1.5, 1.5, len(trial.commands))
    varying = measure(replace(trial, column=column), None, 1.0).q
    constant = measure(replace(trial, column=np.full_like(column, -1.5)), None, 1.0).q
    assert varying > 4 * constant


@cache
def disturbed_photos(disturbance: Disturbance) -> tuple[np.ndarray, np.ndarray]:
    """Of one stroke with the disturbance, and of one after it."""
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
def test_each_disturbance_changes_the_photo_and_then_ends(mode: Mode) -> None:
    amount = {"width": 0.5, "amplitude": 0.5, "blur": 2.0}.get(mode, 0.002)
    plain, disturbed = disturbed_photos(Disturbance("width", 0.0)), disturbed_photos(Disturbance(mode, amount))
    moved = [np.abs(a.astype(int) - b).max() for a, b in zip(plain, disturbed, strict=True)]
    assert moved[0] > 30 and moved[0] > 2 * moved[1]


def test_shift_of_the_canvas_is_hidden_from_the_encoders() -> None:
    world = sketch_world("none", 2, tool="marker").world
    plain, shifted = PaintContext(world, 3), PaintContext(world, 3)
    shifted.disturb(Disturbance("normal", 0.003))
    np.testing.assert_allclose(plain.stroke(LINE), shifted.stroke(LINE), atol=1e-12)


def test_disturbances_follow_their_column() -> None:
    column = np.linspace(-2, 2, 9)
    amounts = [d.amount for d in disturbances(Outside("width", "humidity"), column, 1.0)]
    assert np.all(np.diff(amounts) >= 0) and amounts[4] == 0.0
    assert np.all(np.diff([d.amount for d in disturbances(Outside("width", "humidity"), column, 2.0)]) >= 0)


def test_decoys_vary_and_a_lively_one_does_not_drift() -> None:
    columns = draw_decoys(ROWS, 1, lively="temperature_c")
    assert set(columns) == set(COLUMNS)
    for seed in range(20):
        for name, values in draw_decoys(ROWS, seed, lively="temperature_c").items():
            assert np.isfinite(values).all() and values.std() > 0
            if name == "temperature_c":
                assert abs(np.corrcoef(values, np.arange(ROWS))[0, 1]) < 0.5


def test_causes_are_the_studios_and_every_one_has_a_tool() -> None:
    known = {f.name for f in fields(Effects)}
    assert {cause for causes in CAUSES.values() for cause in causes} == known
    with pytest.raises(ConfigError, match="wet_mixing"):
        sketch_world("one", 1, cause="wet_mixing", tool="marker")
    two = sketch_world("two", 1)
    assert len(set(two.causes)) == 2 == len(two.q)


def test_truth_is_sealed_with_its_figures(tmp_path: Path) -> None:
    truth = Truth("one", 3, "marker", ("latency",), None, (0.2,), (Strength(0.4, 0.21, 0.02),), False)
    write_world(tmp_path, pa.table({"order": [1]}), truth)
    loaded = json.loads((tmp_path / "truth.json").read_text())
    assert loaded["strengths"] == [{"strength": 0.4, "q": 0.21, "q_se": 0.02}]

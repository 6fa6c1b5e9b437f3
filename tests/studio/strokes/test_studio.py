"""The whole studio: what a stroke leaves on the sheet, effect by effect."""

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world
from tests.studio.strokes.worlds import (
    BLACK,
    SCALE,
    arc,
    centroid_m,
    extent_m,
    ink,
    paint,
    straight,
    width_m,
    world_with,
)

PLAIN = world_with()


def test_the_same_commands_give_the_same_bytes() -> None:
    def session(seed: int) -> tuple[bytes, bytes]:
        studio = paint(load_world("round_brush"), straight(), arc(0.02), seed=seed)
        return studio.photo().frame.tobytes(), studio.stroke(straight()).tobytes()

    first, again, other = session(4), session(4), session(5)
    assert first == again
    assert first[0] != other[0]
    assert first[1] != other[1]


def test_a_plain_stroke_covers_its_path_and_little_else() -> None:
    image = ink(paint(PLAIN, straight()))
    x_min, y_min, x_max, y_max = extent_m(image)
    assert centroid_m(image) == pytest.approx((0.125, 0.1), abs=5e-4)
    half = 0.5 * width_m(image, 0.125)
    assert (x_min, x_max) == pytest.approx((0.1 - half, 0.15 + half), abs=1e-3)
    assert y_max - y_min == pytest.approx(2 * half, abs=1e-3)
    row, columns = round(0.1 * SCALE), slice(round(0.105 * SCALE), round(0.145 * SCALE))
    assert np.mean(image[row - 4 : row + 4, columns]) > 0.9


def test_press_widens_a_brush_and_hardly_a_marker() -> None:
    def width(base: str, depth_m: float) -> float:
        return width_m(ink(paint(world_with(base), straight(depth_m=depth_m))), 0.125)

    brush = [width("plain", depth) for depth in (0.0003, 0.002, 0.004)]
    assert 0.002 < brush[0] < 0.0045
    assert 0.0095 < brush[2] < 0.0125
    assert brush[1] - brush[0] > brush[2] - brush[1] > 0
    assert width("marker", 0.001) / width("marker", 0.0002) < 1.25
    assert 0.0016 < width("marker", 0.0005) < 0.0026


def test_a_tool_in_the_air_or_off_the_sheet_leaves_nothing() -> None:
    for path in (straight(depth_m=-0.005), straight(start=(0.5, 0.5))):
        assert ink(paint(PLAIN, path)).max() < 0.1


def test_a_clean_brush_paints_nothing_and_a_new_marker_does() -> None:
    for base, marked in (("plain", False), ("marker", True)):
        studio = Studio(world_with(base), 1)
        studio.stroke(straight())
        assert (ink(studio).max() > 0.5) == marked


def test_depletion_dries_the_brush_and_its_absence_does_not() -> None:
    def coverages(strength: float) -> list[float]:
        studio, before, areas = Studio(world_with(ink_depletion=strength), 1), 0.0, []
        studio.dip(BLACK)
        for i in range(9):
            studio.stroke(straight(start=(0.03 + 0.09 * (i // 5), 0.03 + 0.03 * (i % 5)), length_m=0.05))
            after = float(ink(studio).sum())
            areas.append(after - before)
            before = after
        return areas

    without, with_it = coverages(0.0), coverages(1.0)
    assert min(without) > 0.9 * max(without)
    assert with_it[3] < 0.97 * with_it[0]
    assert with_it[8] < 0.7 * with_it[0]


def test_a_dip_restores_the_load() -> None:
    studio = paint(world_with(ink_depletion=1.0), *[straight(start=(0.03, 0.02 * i + 0.02)) for i in range(9)])
    studio.new_sheet()
    studio.stroke(straight())
    dry = ink(studio).sum()
    studio.new_sheet()
    studio.dip(BLACK)
    studio.stroke(straight())
    assert ink(studio).sum() > 1.2 * dry


def test_lag_shortens_the_stroke_at_its_end_only() -> None:
    path = straight(length_m=0.06, depth_m=0.003)
    plain, lagging = (
        extent_m(ink(paint(PLAIN, path))),
        extent_m(ink(paint(world_with(bristle_lag=1.0), path))),
    )
    assert lagging[0] == pytest.approx(plain[0], abs=2e-3)
    assert 0.001 < plain[2] - lagging[2] < 0.008


def test_a_tilted_sheet_presses_harder_where_it_is_high() -> None:
    paths = [straight(start=(x, 0.1), length_m=0.03, depth_m=0.001) for x in (0.02, 0.25)]
    for world, grows in ((PLAIN, False), (world_with(canvas_tilt=1.0), True)):
        image = ink(paint(world, *paths))
        low, high = width_m(image, 0.035), width_m(image, 0.265)
        assert (high > 1.1 * low) == grows


def test_a_slow_marker_bleeds_and_so_does_absorbing_paper() -> None:
    def width(speed_m_s: float, **strengths: float) -> float:
        return width_m(ink(paint(world_with("marker", **strengths), straight(speed_m_s=speed_m_s))), 0.125)

    plain = width(0.05)
    assert width(0.02) == pytest.approx(plain, rel=0.02)
    assert width(0.02, speed_bleed=1.0) > width(0.1, speed_bleed=1.0) > plain
    assert width(0.05, paper_bleed=1.0) > 1.02 * plain


def test_wet_paint_mixes_and_dry_paint_does_not() -> None:
    def red_in_blue(strength: float, wait_s: float) -> float:
        studio = Studio(world_with(wet_mixing=strength), 1)
        studio.dip((0.8, 0.1, 0.1))
        studio.stroke(straight(start=(0.12, 0.1), depth_m=0.004))
        studio.wipe()
        studio.dip((0.1, 0.1, 0.8))
        studio.wait(wait_s)
        studio.stroke(straight(start=(0.1, 0.1)))
        row, column = round(0.1 * SCALE), round(0.14 * SCALE)
        return float(studio.truth_image(SCALE)[row - 3 : row + 3, column - 20 : column + 20, 0].mean())

    pure = red_in_blue(0.0, 0.0)
    assert red_in_blue(1.0, 0.0) > pure + 0.03
    assert red_in_blue(1.0, 5000.0) == pytest.approx(pure, abs=0.02)


def test_drying_shift_changes_a_stroke_with_time() -> None:
    def change(strength: float) -> float:
        studio = Studio(world_with(drying_shift=strength), 1)
        studio.dip((0.8, 0.7, 0.6))
        studio.stroke(straight())
        wet = studio.truth_image(2000)
        studio.wait(1000)
        return float(np.abs(studio.truth_image(2000) - wet).max())

    assert change(0.0) == 0
    assert change(1.0) > 0.01


def test_opaque_paint_covers_what_lies_beneath() -> None:
    studio = Studio(PLAIN, 1)
    for colour in (BLACK, (0.95, 0.95, 0.93)):
        studio.wipe()
        studio.dip(colour)
        studio.stroke(straight(depth_m=0.003))
    row, column = round(0.1 * SCALE), round(0.125 * SCALE)
    assert studio.truth_image(SCALE)[row - 4 : row + 4, column - 40 : column + 40].mean() > 0.65


def test_time_passes_and_a_new_sheet_is_blank() -> None:
    studio = paint(PLAIN, straight())
    clock = studio.clock_s
    studio.wait(12.0)
    assert studio.clock_s == clock + 12
    studio.new_sheet()
    assert ink(studio).max() < 0.1
    assert studio.clock_s > clock + 12
    assert studio.photo().t_s == studio.clock_s
    assert (studio.canvas_size_m, studio.tool_name) == ((0.3, 0.2), "round_brush")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda p: p[:, :4], r"\[N,5\]"),
        (lambda p: p[:1], r"\[N,5\]"),
        (lambda p: np.where(np.arange(5) == 0, np.nan, p), "not finite"),
        (lambda p: p[::-1], "do not increase"),
    ],
)
def test_impossible_commands_are_refused(spoil, words: str) -> None:
    studio = Studio(PLAIN, 0)
    with pytest.raises(ContractError, match=words):
        studio.stroke(spoil(straight()))


def test_impossible_colours_and_times_are_refused() -> None:
    studio = Studio(PLAIN, 0)
    with pytest.raises(ContractError, match=r"\[0, 1\]"):
        studio.dip((255, 0, 0))
    with pytest.raises(ContractError, match="cannot pass"):
        studio.wait(-1)


def test_force_grows_with_press_and_is_noise_above_the_sheet() -> None:
    studio = Studio(world_with(), 1)
    noise_n = world_with().robot.force_noise_n
    means = []
    for depth_m in (-0.002, 0.001, 0.002, 0.003):
        studio.stroke(straight(depth_m=depth_m))
        means.append(studio.force_n.mean())
        assert studio.force_n.shape == (32,)
        assert studio.force_n.std() == pytest.approx(noise_n, rel=0.6)
    assert abs(means[0]) < noise_n
    assert np.all(np.diff(means[1:]) > 3 * noise_n)
    assert means[3] - means[2] > means[2] - means[1]  # ever more bristles bear

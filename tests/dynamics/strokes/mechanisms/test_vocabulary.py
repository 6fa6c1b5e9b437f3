"""Every cause is the identity at zero, changes the mark otherwise, and smoothly; closed forms of some."""

import numpy as np
import pytest
import torch
from torch import Tensor

from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.mechanisms.backlash import Backlash
from pentimento.dynamics.strokes.mechanisms.canvas_tilt import CanvasTilt
from pentimento.dynamics.strokes.mechanisms.drying_shift import DryingShift
from pentimento.dynamics.strokes.mechanisms.geometry import (
    arc_m,
    bending_per_m,
    speed_m_s,
    tangent,
    trailing,
    usual_speed,
)
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.mechanisms.latency import Latency
from pentimento.dynamics.strokes.mechanisms.lens_distortion import LensDistortion
from pentimento.dynamics.strokes.mechanisms.orientation_width import OrientationWidth
from pentimento.dynamics.strokes.mechanisms.path_offset import PathOffset
from pentimento.dynamics.strokes.mechanisms.path_scale import PathScale
from pentimento.dynamics.strokes.mechanisms.speed_bleed import SpeedBleed
from pentimento.dynamics.strokes.mechanisms.speed_density import SpeedDensity
from pentimento.dynamics.strokes.mechanisms.tool_wear import ToolWear
from pentimento.dynamics.strokes.mechanisms.vignetting import Vignetting
from pentimento.dynamics.strokes.simulation import (
    Mechanism,
    NotObservable,
    StrokeContext,
    View,
    extended_mark,
    simulate,
)
from pentimento.dynamics.strokes.traj2stroke import Mark, Traj2Stroke, Traj2StrokeParameters
from tests.dynamics.documented_causes import documented_causes

COUNT, POINTS = 6, 40
MODEL = Traj2Stroke(Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 0.5, 1e-3, 0.5, 0.9)).requires_grad_(False)


def context() -> StrokeContext:
    """Strokes of all kinds, with everything recorded that a cause may depend on; double precision."""
    rng = np.random.default_rng(0)
    t = np.linspace(0, 1, POINTS)
    paths = []
    for i in range(COUNT):
        heading, bend = rng.uniform(-np.pi, np.pi), rng.uniform(-0.01, 0.01)
        along, across = 0.03 * t, 4 * bend * t * (1 - t)
        start = rng.uniform((0.05, 0.05), (0.2, 0.15))
        x = start[0] + np.cos(heading) * along - np.sin(heading) * across
        y = start[1] + np.sin(heading) * along + np.cos(heading) * across
        paths.append(
            np.column_stack([t * rng.uniform(0.4, 2), x, y, np.full(POINTS, -0.002), np.full(POINTS, 0.2 * i)])
        )
    number = torch.arange(COUNT, dtype=torch.float64)[:, None]
    columns = {
        "ink_since_reload_m": 0.05 * (number % 3),
        "tool_age_m": 0.1 * number,
        "t_start_s": 10 * number,
        "t_after_s": 10 * number + 2 + 3 * (number % 4),
        "wet_age_s": torch.where(number > 2, 5.0 * number, torch.nan),
        "carried_share": 0.3 * (number % 3),
        "carried_red": 0.1 * number,
        "carried_green": 0.2 + 0.05 * number,
        "carried_blue": 0.9 - 0.05 * number,
        "surface_level": number % 6,
        "humidity": 40.0 + 7 * (number % 4),
    }
    return StrokeContext(torch.tensor(np.stack(paths))[:, None], columns)


def image(mechanism: Mechanism) -> Tensor:
    strokes = context()
    corner = strokes.path[:, 0, 0, 1:3] + torch.tensor([-0.04, 0.04])
    view = View(corner, torch.full((COUNT,), 500.0, dtype=torch.float64))
    canvas = torch.full((COUNT, 40, 40, 4), 0.8, dtype=torch.float64)
    color = torch.tensor([0.3, 0.1, 0.1], dtype=torch.float64).expand(COUNT, 1, 3)
    needs_wet = mechanism.cause == "wet_mixing"
    return simulate(
        MODEL.double(),
        [mechanism],
        strokes,
        color=color,
        canvas=canvas if needs_wet else canvas[..., :3].contiguous(),
        view=view,
    )


def made(kind: type[Mechanism], *values: float) -> Mechanism:
    return kind(torch.tensor(values, dtype=torch.float64), kind.reference_of(context()))


def test_every_cause_is_described_in_the_documentation_and_has_a_file_of_its_name() -> None:
    names = [kind.cause for kind in VOCABULARY]
    assert sorted(names) == sorted(documented_causes("strokes"))
    assert all(kind.__module__.endswith(f".{kind.cause}") for kind in VOCABULARY)


@pytest.mark.parametrize("kind", VOCABULARY, ids=lambda kind: kind.cause)
def test_mechanism_is_identity_at_zero_and_changes_the_image_otherwise(kind: type[Mechanism]) -> None:
    plain = image(made(kind, *[0.0] * len(kind.quantities)))
    nothing = simulate_plain()
    torch.testing.assert_close(plain, nothing, atol=1e-4, rtol=0)
    for number, quantity in enumerate(kind.quantities):
        values = [0.0] * len(kind.quantities)
        values[number] = quantity.typical
        assert float((image(made(kind, *values)) - plain).abs().max()) > 0.003, quantity.name


def simulate_plain() -> Tensor:
    return image(made(PathScale, 0.0, 0.0))


@pytest.mark.parametrize("kind", VOCABULARY, ids=lambda kind: kind.cause)
def test_marks_move_smoothly_with_the_quantities(kind: type[Mechanism]) -> None:
    """Automatic differentiation against finite differences, at half the typical size."""
    strokes, reference = context(), kind.reference_of(context())
    typical = torch.tensor([q.typical for q in kind.quantities], dtype=torch.float64)
    weight = torch.tensor(np.random.default_rng(1).normal(size=(COUNT, 1, POINTS)))

    def total(share: Tensor) -> Tensor:
        mechanism = kind(share * typical, reference)
        mark = extended_mark(MODEL.double(), [mechanism], strokes)
        color, pickup = mechanism.composite(torch.full((COUNT, 1, 3), 0.3, dtype=torch.float64), None, strokes)
        picture = mechanism.camera(
            torch.ones(COUNT, 4, 5, 3, dtype=torch.float64),
            View(strokes.path[:, 0, 0, 1:3], torch.full((COUNT,), 500.0)),
        )
        drawn = ((mark.points_m.sum(-1) * 1e3 + mark.radius_m * 1e3 + mark.density + mark.softness) * weight).sum()
        return (
            drawn
            + (color * weight[..., :3]).sum()
            + (picture.mean() * 10)
            + (0 if pickup is None else (pickup * weight[..., 0]).sum())
        )

    at = torch.full((len(typical),), 0.5, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(total, (at,), eps=1e-6, atol=1e-5)


def line(length_m: float = 0.04) -> Tensor:
    x = torch.linspace(0, length_m, 50, dtype=torch.float64)
    return torch.stack([x, torch.zeros_like(x)], dim=-1)[None, None]


def test_trailing_relaxes_exponentially_on_a_straight_line() -> None:
    points, distance = line(), 0.006
    behind = points[..., 0] - trailing(points, torch.full((1, 1, 1), distance, dtype=torch.float64))[..., 0]
    torch.testing.assert_close(behind, distance * (1 - torch.exp(-points[..., 0] / distance)))


def test_trailing_cuts_corners_in_proportion_to_its_distance() -> None:
    corner = torch.cat([line(0.02), line(0.02).flip(-1) + torch.tensor([0.02, 0.0])], dim=-2)
    for distance in (0.001, 0.005):
        trail = trailing(corner, torch.full((1, 1, 1), distance, dtype=torch.float64))
        cut = (trail - torch.tensor([0.02, 0.0])).norm(dim=-1).amin()
        assert 0.1 * distance < float(cut) < distance


def test_latency_delays_the_path_by_its_time() -> None:
    time_s, t = 0.05, torch.linspace(0, 0.5, 200, dtype=torch.float64)
    still = torch.zeros_like(t)
    strokes = StrokeContext(torch.stack([t, t**2, still, still, still], dim=-1)[None, None], {})
    mark = MODEL.double()(strokes.path)._replace(points_m=strokes.path[..., 1:3])
    for late_s in (time_s, -time_s):
        late = made(Latency, late_s).mark(mark, strokes).points_m[0, 0, :, 0]
        torch.testing.assert_close(late, (t - late_s).clamp(0.0, 0.5) ** 2, atol=1e-5, rtol=0)


def test_without_times_a_late_tip_trails_by_the_usual_speed() -> None:
    path = line(0.02)
    path = torch.cat([torch.full_like(path[..., :1], torch.nan), path, torch.zeros_like(path)], dim=-1)
    strokes = StrokeContext(path, {})
    mark = MODEL.double()(torch.nan_to_num(path))._replace(points_m=path[..., 1:3])
    latency = Latency(torch.tensor([0.05], dtype=torch.float64), {"speed_m_s": 0.1})
    behind = path[..., 1] - latency.mark(mark, strokes).points_m[..., 0]
    torch.testing.assert_close(behind, (path[..., 1] - path[..., :1, 1]).clamp(max=0.005))


def offset_by_play(path: Tensor, x_m: float, y_m: float) -> Tensor:
    """Of each point of paths [B, S, N, 5], [B, S, N, 2]."""
    mark = made(Backlash, x_m, y_m).mark(MODEL.double()(path), context()._replace(path=path))
    return mark.points_m - path[..., 1:3]


def test_backlash_turns_over_with_the_axis_by_the_way_that_it_goes() -> None:
    way = torch.linspace(0, 0.03, POINTS, dtype=torch.float64)
    there_and_back = torch.cat([way, way.flip(0)[1:]])
    path = torch.zeros(1, 1, len(there_and_back), 5, dtype=torch.float64)
    path[..., 1] = there_and_back
    offset = offset_by_play(path, 5e-4, 5e-4)
    turned = torch.exp(-way / 5.5e-4)
    torch.testing.assert_close(offset[0, 0, :POINTS, 0], -5e-4 * (1 - 0.5 * turned))
    torch.testing.assert_close(offset[0, 0, POINTS:, 0], 5e-4 * (1 - (2 - 0.5 * turned[-1]) * turned[1:]))
    assert not offset[..., 1].any()


def test_backlash_of_one_axis_goes_with_its_own_motion_alone() -> None:
    path = context().path
    mirrored = torch.cat([path[..., :1], -path[..., 1:2], path[..., 2:]], dim=-1)
    torch.testing.assert_close(
        offset_by_play(mirrored, 5e-4, 3e-4), offset_by_play(path, 5e-4, 3e-4) * torch.tensor([-1.0, 1.0])
    )


def test_depletion_goes_on_along_the_stroke() -> None:
    strokes = context()
    mark = made(InkDepletion, 0.3, 0.0).mark(MODEL.double()(strokes.path), strokes)
    assert bool((mark.density.diff(dim=-1) < 0).all())
    fresh, used = mark.density[0, 0, 0], mark.density[1, 0, 0]
    assert float(fresh) == pytest.approx(0.9) and float(used) < 0.9


def test_lens_distortion_leaves_the_middle_and_grows_with_the_cube() -> None:
    torch.testing.assert_close(through_lens(8e-4, 0.0), torch.tensor([0.0, 1e-4, 8e-4], dtype=torch.float64))


def test_a_rectification_by_markers_keeps_these_at_their_places() -> None:
    edge = through_lens(8e-4, 8e-4)
    assert float(edge[0]) == float(edge[2]) == 0 and float(edge[1]) < 0


def through_lens(at_edge_m: float, pickup_m: float) -> torch.Tensor:
    """By how much the middle, a point half way to the edge and one at the edge are displaced outwards, m."""
    reference = {"x_m": 0.1, "y_m": 0.1, "half_m": 0.1}
    points = torch.tensor([[[[0.1, 0.1], [0.15, 0.1], [0.2, 0.1]]]], dtype=torch.float64)
    one = torch.ones(1, 1, 3, dtype=torch.float64)
    lens = LensDistortion(torch.tensor([at_edge_m, pickup_m], dtype=torch.float64), reference)
    return (lens.mark(Mark(points, one, one, one), context()).points_m - points)[0, 0, :, 0]


def test_orientation_repeats_at_half_turns() -> None:
    strokes = context()
    turned = strokes.path.clone()
    turned[..., 4] += np.pi
    wide = made(OrientationWidth, 0.2, 0.1)
    a, b = (wide.mark(MODEL.double()(p), strokes._replace(path=p)).radius_m for p in (strokes.path, turned))
    torch.testing.assert_close(a, b)


def test_orientation_needs_strokes_that_run_in_several_directions() -> None:
    strokes = context()
    path = strokes.path.clone()
    chord = path[..., -1, 1:3] - path[..., 0, 1:3]
    path[..., 4] = (torch.atan2(chord[..., 1], chord[..., 0]) + 0.3 * np.pi)[..., None]  # the arm turns with the stroke
    with pytest.raises(NotObservable, match="same way"):
        OrientationWidth.reference_of(strokes._replace(path=path))
    assert OrientationWidth.reference_of(strokes) == {}


def half_darkness_m(mark: Mark) -> Tensor:
    """How far beside the path the mark is half as dark as on it."""
    return mark.radius_m * (1 - 0.5 ** (1 / mark.softness))


def test_softening_keeps_the_line_of_half_darkness_and_spreading_moves_it() -> None:
    strokes = context()
    plain = MODEL.double()(strokes.path)
    softer = made(SpeedBleed, 0.8, 0.0).mark(plain, strokes)
    torch.testing.assert_close(half_darkness_m(softer), half_darkness_m(plain))
    assert float((softer.softness / plain.softness).log().abs().max()) > 0.1
    further = made(SpeedBleed, 0.8, 0.3).mark(plain, strokes)
    torch.testing.assert_close(further.softness, softer.softness)
    moved = (half_darkness_m(further) / half_darkness_m(plain)).log()
    torch.testing.assert_close(moved, (softer.softness / plain.softness).log() * 0.3 / 0.8)


def test_less_paint_is_paler_and_may_be_softer_and_further_in() -> None:
    strokes = context()
    plain = MODEL.double()(strokes.path)
    faster = torch.log(speed_m_s(strokes.path) / usual_speed(strokes)["speed_m_s"])[..., None]
    thin = made(SpeedDensity, -0.2, 0.4, -0.1).mark(plain, strokes)
    torch.testing.assert_close((thin.density / plain.density).log(), (-0.2 * faster).expand_as(thin.density))
    torch.testing.assert_close((thin.softness / plain.softness).log(), (0.4 * faster).expand_as(thin.density))
    moved = (half_darkness_m(thin) / half_darkness_m(plain)).log()
    torch.testing.assert_close(moved, (-0.1 * faster).expand_as(moved))


def test_canvas_tilt_acts_as_a_change_of_press_depth() -> None:
    strokes = context()
    strokes.path[..., 3] *= torch.linspace(0.5, 1.5, COUNT)[:, None, None]
    tilt = CanvasTilt(torch.tensor([4e-4, 0.0], dtype=torch.float64), CanvasTilt.reference_of(strokes))
    deeper_m = 4e-4 * (strokes.path[..., 1] - tilt.reference["x_m"]) / tilt.reference["half_m"]
    pressed = strokes.path.clone()
    pressed[..., 3] -= deeper_m
    torch.testing.assert_close(
        extended_mark(MODEL.double(), [tilt], strokes), MODEL.double()(pressed), atol=1e-12, rtol=0
    )


def test_where_all_strokes_are_pressed_same_heading_a_tilt_is_another_width() -> None:
    strokes = context()
    tilt = made(CanvasTilt, 4e-4, 0.0)
    plain, tilted = extended_mark(MODEL.double(), [], strokes), extended_mark(MODEL.double(), [tilt], strokes)
    wider_m = tilted.radius_m - plain.radius_m
    reference = tilt.reference
    share = (strokes.path[..., 1] - reference["x_m"]) / reference["half_m"]
    torch.testing.assert_close(wider_m, reference["half_width_per_press"] * 4e-4 * share, atol=1e-12, rtol=0)


def test_drying_shift_has_two_drynesses_and_none_at_the_usual_age() -> None:
    """Most strokes are seen after seconds and few after minutes: a slow paint has changed in the latter alone."""
    strokes, ages_s = context(), torch.tensor([2.0, 2.0, 2.0, 2.0, 20.0, 200.0], dtype=torch.float64)[:, None]
    duration_s = strokes.path[..., -1, 0] - strokes.path[..., 0, 0]
    columns = dict(strokes.covariates) | {"t_after_s": strokes.covariates["t_start_s"] + duration_s + ages_s}
    seen = strokes._replace(covariates=columns)
    reference, grey = DryingShift.reference_of(seen), torch.ones(COUNT, 1, 3, dtype=torch.float64)

    def drift(number: int, context: StrokeContext) -> Tensor:
        values = torch.zeros(6, dtype=torch.float64)
        values[number] = 1.0
        return DryingShift(values, reference).composite(grey, None, context)[0][:, 0, 0].log()

    soon, late = drift(3, seen), drift(5, seen)
    assert float(soon[5] - soon[4]) < 0.2 * float(soon[4] - soon[0])
    assert float(late[5] - late[4]) > 5 * float(late[4] - late[0])
    usual = seen.covariates["t_start_s"] + duration_s + reference["usual_age_s"]
    for number in (3, 5):
        for when in (usual, torch.full_like(usual, torch.nan)):
            now = seen._replace(covariates=columns | {"t_after_s": when})
            torch.testing.assert_close(drift(number, now), torch.zeros(COUNT, dtype=torch.float64), atol=1e-9, rtol=0)


def test_strokes_that_took_nobody_knows_how_long_have_no_age() -> None:
    """The slower a stroke, the later after its start it is seen: what goes with speed would pass for drying."""
    strokes = context()
    after_s = strokes.covariates["t_start_s"] + torch.linspace(3.0, 9.0, COUNT, dtype=torch.float64)[:, None]
    seen = strokes._replace(covariates=dict(strokes.covariates) | {"t_after_s": after_s})
    untimed = seen._replace(path=torch.cat([seen.path[..., :1] * torch.nan, seen.path[..., 1:]], dim=-1))
    assert "usual_age_s" in DryingShift.reference_of(seen)
    assert "usual_age_s" not in DryingShift.reference_of(untimed)


def test_wear_that_levels_off_is_the_same_at_both_ends_of_the_session() -> None:
    strokes = context()
    plain = MODEL.double()(strokes.path)
    even, level = (made(ToolWear, 0.1, ahead, 0.0).mark(plain, strokes).radius_m[:, 0, 0] for ahead in (0.0, 0.05))
    torch.testing.assert_close(level[[0, -1]], even[[0, -1]])
    middle = (level / even).log()
    torch.testing.assert_close(middle, 0.05 * (1 - torch.linspace(-1, 1, COUNT, dtype=torch.float64) ** 2))


def test_what_was_not_recorded_is_not_observable() -> None:
    strokes = context()
    blind = StrokeContext(torch.cat([strokes.path[..., :1] * torch.nan, strokes.path[..., 1:]], dim=-1), {})
    for kind in VOCABULARY:
        if kind.cause in (
            "ink_depletion",
            "speed_width",
            "latency",
            "tool_wear",
            "drying_shift",
            "wet_mixing",
            "paper_bleed",
        ):
            with pytest.raises(NotObservable):
                kind.reference_of(blind)


def test_strokes_in_their_own_frames_keep_their_turn_unless_they_are_turned_too() -> None:
    """The contract's stroke frame moves the origin; some recordings also turn each stroke along x."""
    strokes = context()
    path = strokes.path.clone()
    path[..., 1:3] -= path[..., :1, 1:3].clone()
    moved = StrokeContext(path, strokes.covariates)
    turned = path.clone()
    angle = torch.atan2(path[..., -1, 2], path[..., -1, 1])[..., None]
    turned[..., 1] = path[..., 1] * angle.cos() + path[..., 2] * angle.sin()
    turned[..., 2] = path[..., 2] * angle.cos() - path[..., 1] * angle.sin()
    same_heading = StrokeContext(turned, strokes.covariates)
    for cause in (Backlash, OrientationWidth, PathOffset):
        cause.reference_of(moved)
        with pytest.raises(NotObservable, match="turned"):
            cause.reference_of(same_heading)
    for cause in (CanvasTilt, Vignetting):
        with pytest.raises(NotObservable, match="places"):
            cause.reference_of(moved)


def test_geometry_of_a_circle() -> None:
    angle = torch.linspace(0, 3, 200, dtype=torch.float64)
    radius = 0.02
    circle = torch.zeros(1, 1, 200, 5, dtype=torch.float64)
    circle[..., 1], circle[..., 2] = radius * torch.cos(angle), radius * torch.sin(angle)
    circle[..., 0] = angle / 3 * 2.0
    torch.testing.assert_close(
        bending_per_m(circle), torch.full((1, 1, 200), 1 / radius, dtype=torch.float64), rtol=1e-3, atol=0
    )
    assert float(arc_m(circle)[0, 0, -1]) == pytest.approx(3 * radius, rel=1e-3)
    assert float(speed_m_s(circle)) == pytest.approx(3 * radius / 2, rel=1e-3)
    torch.testing.assert_close(
        (tangent(circle) * circle[..., 1:3]).sum(-1)[..., 1:-1],
        torch.zeros(1, 1, 198, dtype=torch.float64),
        atol=1e-6,
        rtol=0,
    )


@pytest.mark.parametrize("kind", VOCABULARY, ids=lambda kind: kind.cause)
def test_a_column_with_gaps_is_passed_over(kind: type[Mechanism]) -> None:
    """What a cause reads is the column that its reference was taken from, not the first that bears a fitting name."""
    whole = context()
    gaps = {n: v.clone() for n, v in whole.covariates.items()} | {"order": torch.arange(COUNT).double()[:, None]}
    gaps["since_reload"] = (torch.arange(COUNT) % 3).double()[:, None]
    gaps["humidity"] = 40 + 5 * torch.sin(torch.arange(COUNT))[:, None].double()
    for name in ("tool_age_m", "t_start_s", "ink_since_reload_m", "surface_level"):
        gaps[name][1] = torch.nan
    strokes = StrokeContext(whole.path, gaps)
    reference = kind.reference_of(strokes)
    mechanism = kind(torch.tensor([q.typical for q in kind.quantities], dtype=torch.float64), reference)
    mark = mechanism.mark(MODEL.double()(strokes.path), strokes)
    color, _ = mechanism.composite(torch.ones(COUNT, 1, 3, dtype=torch.float64), None, strokes)
    assert all(bool(torch.isfinite(field).all()) for field in (*mark, color))

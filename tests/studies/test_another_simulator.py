"""The second simulator: ink lies where the command says, and each fault does what its name says."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from pentimento.contracts.images import decode_png
from studies.another_simulator.arm import Arm, Command, arc_m, drawn_command
from studies.another_simulator.marks import Tool, drawn_tool, mark, widths_m
from studies.another_simulator.session import recorded
from studies.another_simulator.table import page
from studies.another_simulator.world import Effects, ToolKind, World

WINDOW_M = np.array([0.0, 0.0, 0.06, 0.06])


def straight(speed_m_s: float = 0.05, toward: float = 1.0) -> Command:
    x = np.linspace(0.02, 0.04, 24)[:: int(toward)]
    xy = np.stack([x, np.full(24, 0.03)], axis=1)
    return Command(arc_m(xy) / speed_m_s, xy, np.full(24, -0.002), 0.0, speed_m_s, 0.02)


def contact(effects: Effects, command: Command) -> np.ndarray:
    return Arm(effects, np.random.default_rng(0)).contact(command)[0]


def covered_m2(tool: Tool, effects: Effects, command: Command, worn: float = 0.0, damp: float = 0.0) -> float:
    xy, press = Arm(Effects(), np.random.default_rng(0)).contact(command)
    width = widths_m(tool, effects, command, xy_m=xy, press_m=press, worn=worn, damp=damp)
    return float(mark(tool, xy, press, width_m=width, yaw_rad=0.0, window_m=WINDOW_M, pixels_per_m=1000.0).sum() * 1e-6)


@pytest.mark.parametrize("kind", get_args(ToolKind))
def test_a_mark_lies_about_its_path_and_is_as_large_as_its_width_says(kind: ToolKind) -> None:
    tool = drawn_tool(np.random.default_rng(1), kind)
    command = straight()
    xy, press = Arm(Effects(), np.random.default_rng(0)).contact(command)
    width = widths_m(tool, Effects(), command, xy_m=xy, press_m=press, worn=0.0, damp=0.0)
    made = mark(
        tool, xy, press, width_m=width, yaw_rad=0.0, window_m=WINDOW_M, pixels_per_m=4000.0
    )  # OpenCV's smooth edges add half a pixel all round
    rows, columns = np.indices(made.shape)
    x = (made * (columns + 0.5)).sum() / made.sum() / 4000
    y = 0.06 - (made * (rows + 0.5)).sum() / made.sum() / 4000
    assert (x, y) == pytest.approx(tuple(xy.mean(0)), abs=1e-4)
    whole = {"nib": 0.02 * width[0] + np.pi * width[0] ** 2 / 4, "chisel": (0.02 + width[0]) * width[0] / 3}
    if kind in whole:
        assert made.sum() / 4000**2 == pytest.approx(whole[kind], rel=0.12)


def test_up_is_up() -> None:
    tool, command = drawn_tool(np.random.default_rng(1), "nib"), straight()
    high = np.column_stack([command.xy_m[:, 0], np.full(24, 0.05)])
    made = mark(
        tool, high, np.full(24, 0.002), width_m=np.full(24, 0.003), yaw_rad=0.0, window_m=WINDOW_M, pixels_per_m=1000.0
    )
    assert made[:20].sum() > 0.99 * made.sum()


def test_faults_move_the_contact_as_their_names_say() -> None:
    command = straight()
    plain = contact(Effects(), command)
    assert contact(Effects(path_offset=0.001), command) - plain == pytest.approx(np.tile([0.001, -0.0006], (160, 1)))
    assert np.ptp(contact(Effects(path_scale=0.1), command)[:, 0]) == pytest.approx(1.1 * np.ptp(plain[:, 0]))
    late = contact(Effects(latency=0.1), command)
    assert plain[-1, 0] - late[-1, 0] == pytest.approx(0.1 * command.speed_m_s)
    assert late[0] == pytest.approx(plain[0])
    assert plain[-1, 0] - contact(Effects(bristle_lag=0.004), command)[-1, 0] == pytest.approx(0.004)
    there, back = (contact(Effects(backlash=0.002), straight(toward=toward)) for toward in (1, -1))
    assert back[-1, 0] - straight(toward=-1).xy_m[-1, 0] > there[-1, 0] - command.xy_m[-1, 0] + 0.0015


@pytest.mark.parametrize(
    ("effects", "more", "less"),
    [
        (Effects(tool_wear=0.3), {"worn": 1.0}, {"worn": 0.1}),
        (Effects(paper_bleed=0.2), {"damp": 1.0}, {"damp": -1.0}),
    ],
)
def test_marks_widen_with_wear_and_damp(effects: Effects, more: dict[str, float], less: dict[str, float]) -> None:
    tool = drawn_tool(np.random.default_rng(1), "nib")
    assert covered_m2(tool, effects, straight(), **more) > 1.1 * covered_m2(tool, effects, straight(), **less)


def test_a_fast_mark_is_narrower() -> None:
    tool, effects = drawn_tool(np.random.default_rng(1), "nib"), Effects(speed_width=0.3)
    assert covered_m2(tool, effects, straight(0.1)) < 0.8 * covered_m2(tool, effects, straight(0.02))


def test_paint_runs_out_between_dips() -> None:
    world = World("", "nib", 3, Effects(ink_depletion=10.0), rows=40, repeats=False)
    rows = recorded(world).to_pylist()
    dark = [float((decode_png(r["before"]["bytes"]) - 1.0 * decode_png(r["after"]["bytes"])).max()) for r in rows]
    far = [r["ink_since_reload_m"] for r in rows]
    assert np.corrcoef(far, dark)[0, 1] < -0.7


def test_repeats_are_of_one_command_and_anything_else_varies() -> None:
    table = recorded(World("", "hairs", 4, rows=80, painted_over=True)).to_pydict()
    actions, counts = np.unique(table["action_id"], return_counts=True)
    assert sorted(counts)[-24:] == [3] * 24 and len(actions) == 80 - 48
    again = [k for k, action in enumerate(table["action_id"]) if action == actions[counts == 3][0]]
    assert table["path"][again[0]] == table["path"][again[1]]
    assert drawn_command(np.random.default_rng(1), "nib").length_m != drawn_command(np.random.default_rng(2), "nib")


def test_the_page_counts_what_is_exact() -> None:
    def said(*causes: str) -> dict[str, object]:
        established = [{"cause": cause, "rivals": []} for cause in causes]
        verdict = {"established": established, "gap_closed": {"test": 0.5}}
        return {"verdict": verdict, "rivals": {"pixels": ["tool_wear"]}, "seconds": 3.0}

    late = World("late", "nib", 1, Effects(latency=0.1))
    text = page({late: said("latency"), replace(late, tool="chisel"): said("latency", "backlash")})
    assert "in 1 of 2 worlds; with the likelihood of pixels, in 0. False names: 1 of 3." in text


def test_in_numbers_pale_paint_mixes_darker_than_in_light() -> None:
    world = World("red", "nib", 3, Effects(speed_density=0.3), rows=4, repeats=False, color_srgb=(0.6, 0.15, 0.1))
    in_light, in_numbers = (
        [decode_png(row["bytes"]).astype(int) for row in recorded(w)["after"].to_pylist()]
        for w in (world, replace(world, mixed_in="numbers"))
    )
    for light, numbers in zip(in_light, in_numbers, strict=True):
        assert (numbers <= light).all()
        assert (numbers < light).mean() > 0.01


def test_a_session_paints_with_its_own_mix() -> None:
    plain = World("", "nib", 3, rows=12, repeats=False, sessions=2)
    darkest = [
        [decode_png(row["bytes"]).min() for row in recorded(world)["after"].to_pylist()]
        for world in (plain, replace(plain, mixes=(1.0, 0.5)))
    ]
    assert darkest[0][:6] == darkest[1][:6]
    assert all(pale > dark + 20 for dark, pale in zip(darkest[0][6:], darkest[1][6:], strict=True))


def test_without_times_nothing_that_goes_with_speed_can_be_found() -> None:
    world = World("", "chisel", 3, Effects(speed_width=0.2, latency=0.05, path_scale=0.05), 4, False, timed=False)
    assert world.truth == {"path_scale", "orientation_width"}
    assert np.isnan(np.array(recorded(world)["path"].to_pylist()[0])[:, 0]).all()

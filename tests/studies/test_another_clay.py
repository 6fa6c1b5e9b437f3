"""The second clay: a push lies where the command says, volume is kept, and each fault does what its name says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.height_maps import decode_height_m
from studies.another_clay import session
from studies.another_clay.ploughing import PIXEL_MM, PIXELS, slide
from studies.another_clay.push import X_MM, Y_MM, Command, Conditions, pushed
from studies.another_clay.session import recorded
from studies.another_clay.table import page
from studies.another_clay.world import Clay, Effects, World

LEVEL = np.full((PIXELS, PIXELS), 40.0)
UNTOUCHED = np.zeros((PIXELS, PIXELS))
COMMAND = Command(90.0, 110.0, 0.5, 20.0, 5.0, 1.0, 0.03, 0.05)
FAULTLESS = Effects()
USUAL = Conditions(22.0, 45.0, 24.0, 0.0)


def change(
    effects: Effects = FAULTLESS,
    command: Command = COMMAND,
    conditions: Conditions = USUAL,
    worked: np.ndarray = UNTOUCHED,
) -> np.ndarray:
    """Millimetres [N, N], upwards."""
    return pushed(LEVEL, worked, command, conditions=conditions, clay=Clay(), effects=effects, rough=UNTOUCHED) - LEVEL


def middle(pressed: np.ndarray) -> tuple[float, float]:
    """x, y of what is pressed down, millimetres."""
    dent = np.clip(-pressed - 0.5, 0, None)
    return float((dent * X_MM).sum() / dent.sum()), float((dent * Y_MM).sum() / dent.sum())


def test_push_follows_its_path_is_deepest_at_its_end_and_keeps_the_volume() -> None:
    made = change()
    row, column = np.unravel_index(made.argmin(), made.shape)
    end = 90 + 20 * np.cos(0.5), 110 + 20 * np.sin(0.5)
    assert (X_MM[row, column], Y_MM[row, column]) == pytest.approx(end, abs=2.5)
    assert made.min() == pytest.approx(-5.0, abs=1.0)
    assert abs(made.sum()) < 0.02 * np.abs(made).sum()
    x, y = middle(made)
    ahead, aside = (x - 90) * np.cos(0.5) + (y - 110) * np.sin(0.5), (y - 110) * np.cos(0.5) - (x - 90) * np.sin(0.5)
    assert 10 < ahead < 20 and abs(aside) < 0.3


def test_tool_offsets_follow_its_faults() -> None:
    still = middle(change())
    assert change(Effects(height_offset=1.0)).min() < change().min() - 0.7
    x, y = middle(change(Effects(tool_backlash=2.0)))
    assert x == pytest.approx(still[0] - 2.0, abs=0.4) and y == pytest.approx(still[1] - 1.2, abs=0.4)
    back = replace(COMMAND, x_mm=110.0, theta_rad=0.5 + np.pi)
    assert middle(change(Effects(tool_backlash=2.0), back))[0] > middle(change(command=back))[0] + 1.5


def test_a_dent_springs_back_the_less_the_longer_the_tool_rests() -> None:
    effects = Effects(springback=0.5)
    short, long = (change(effects, replace(COMMAND, dwell_s=dwell)).min() for dwell in (0.0, 4.0))
    assert change().min() < long < short - 0.5


def test_volume_is_lost_or_rises_far_around() -> None:
    assert change(Effects(volume_loss=0.5)).sum() < -0.2 * np.abs(change()).sum() / 2
    far = change(Effects(far_field=0.5))
    assert abs(far.sum()) < 0.02 * np.abs(far).sum()
    away = np.hypot(X_MM - 100, Y_MM - 115) > 50
    assert far[away].sum() > 0.02 * np.clip(-far, 0, None).sum() > 10 * abs(change()[away].sum())


def test_worked_clay_holds_the_tool_up() -> None:
    worked = np.where(np.hypot(X_MM - 107, Y_MM - 119) < 15, 6.0, 0.0)
    effects = Effects(work_hardening=0.5)
    assert change(effects, worked=worked).min() > change(effects).min() + 1.0
    assert np.array_equal(change(worked=worked), change())


def test_clay_that_sticks_rises_the_higher_the_faster_the_tool_leaves_and_none_is_made() -> None:
    slow, fast = (
        change(Effects(adhesion_lift=1.5), replace(COMMAND, retract_speed_m_s=speed)) for speed in (0.01, 0.1)
    )
    end = np.hypot(X_MM - 90 - 20 * np.cos(0.5), Y_MM - 110 - 20 * np.sin(0.5)) < 2
    assert change()[end].mean() < slow[end].mean() < fast[end].mean() - 1.0
    assert fast.sum() == pytest.approx(change().sum(), abs=1.0)


@pytest.mark.parametrize(
    ("effects", "more"),
    [
        (Effects(stiff_when_cold=0.3), {"temperature_c": 26.0}),
        (Effects(stiffens=0.6), {"stiffened": -0.4}),
        (Effects(deep_by_volts=0.3), {"supply_v": 24.6}),
        (Effects(wide_when_damp=0.3), {"humidity_pct": 65.0}),
    ],
)
def test_conditions_make_a_push_larger(effects: Effects, more: dict[str, float]) -> None:
    dent = [np.clip(-change(effects, conditions=there), 0, None).sum() for there in (USUAL, replace(USUAL, **more))]
    assert dent[1] > 1.1 * dent[0]
    assert np.array_equal(change(conditions=replace(USUAL, **more)), change())


def test_a_long_rest_lets_a_tool_sink() -> None:
    effects = Effects(sinks_at_rest=1.5)
    short, long = (change(effects, replace(COMMAND, dwell_s=dwell)).min() for dwell in (0.0, 4.0))
    assert long < change().min() - 0.5 < short - 1.0


def test_slopes_slide_to_a_stable_angle_and_keep_the_volume() -> None:
    pit = np.where(np.hypot(X_MM - 100, Y_MM - 100) < 10, 35.0, 40.0)
    slid = pit.copy()
    slide(slid, 1.0, (0, PIXELS, 0, PIXELS), 500)
    steepest = np.abs(np.diff(slid, axis=0)).max() / PIXEL_MM
    assert steepest < 1.05 < np.abs(np.diff(pit, axis=0)).max() / PIXEL_MM
    assert slid.sum() == pytest.approx(pit.sum(), rel=1e-9)


def test_repeats_have_one_command_on_fresh_slabs_and_scans_have_holes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "_SINGLES", 6)
    monkeypatch.setattr(session, "_AGAIN", 2)
    table = recorded(World("", 3, Clay(), repeats_together=True)).to_pydict()
    actions, counts = np.unique(table["action_id"], return_counts=True)
    assert sorted(counts) == [1] * 6 + [3] * 2
    again = [k for k, action in enumerate(table["action_id"]) if action == actions[counts == 3][0]]
    assert table["action"][again[0]] == table["action"][again[2]] and np.ptp(again) == 2
    assert all(table["pushes_since_reset"][k] == 0 for k in again)
    heights = decode_height_m(table["before"][0]["bytes"], 1e-6)
    assert 0 < np.isnan(heights).sum() < 100
    assert np.nanmedian(heights) == pytest.approx(0.04, abs=5e-4)


def test_the_page_counts_what_is_exact() -> None:
    entry = {"cause": "far_field", "rivals": []}
    verdict = {"established": [entry], "gap_closed": {"test": 0.9}, "unexplained": []}
    entries = [{"mode": "width", "covariate": "humidity_pct"}]
    nothing = {"established": [], "gap_closed": {"test": 0.0}, "unexplained": entries}
    worlds = World("far", 1, Clay(), Effects(far_field=0.5)), World("damp", 2, Clay(), Effects(wide_when_damp=0.1))
    said = {world: {"verdict": v, "seconds": 9.0} for world, v in zip(worlds, (verdict, nothing), strict=True)}
    text = page(said)
    assert (
        "equal the hidden ones in 2 of 2 worlds" in text
        and "False names: 0 of 1" in text
        and "never names a cause would be right in 1" in text
    )
    assert "| damp | nothing | nothing | – | – | width by humidity_pct | 9 |" in text
    swapped = dict(zip(worlds, reversed(said.values()), strict=True))
    assert "equal the hidden ones in 0 of 2 worlds" in page(swapped)

"""A sculpture by the lean runner: its recording, its resumption, and refused arguments."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control import run_sculpture as module
from pentimento.control.checkpoint import SculptureState, load_sculpture
from pentimento.control.commission import ClayCommission, read_clay_commission
from pentimento.control.person import Control, Progress
from pentimento.control.run_sculpture import Ended, clay_commission_of, run_sculpture
from pentimento.planning.pushes.goal import GoalError, sunken_letters
from pentimento.robots.virtual import VirtualSculptingRobot
from tests.bundle.tiny_bundle import write_tiny_bundle
from tests.control.sculpting_bundle import FACTS, SETTINGS, add_clay
from tests.planning.pushes.clay import PressedClay


@pytest.fixture
def bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A bundle with a push model of foam, with the tests' model of clay in place of its graphs."""
    folder = add_clay(write_tiny_bundle(tmp_path / "bundle"))
    monkeypatch.setattr(module, "clay_members", lambda *_: (PressedClay(window_m=np.array(FACTS.window_m)),))
    return folder


def commissioned(bundle: Path, actions: int = 4) -> ClayCommission:
    return clay_commission_of(bundle, "foam", "T", actions=actions, seed=3)


def sculpted(commission: ClayCommission, folder: Path, resume: bool = False) -> SculptureState:
    return run_sculpture(commission, folder, resume=resume, control=Control(), progress=Progress())


class Killed(BaseException):
    """Stands for the end of the process: nothing catches it."""


def killed_at(monkeypatch: pytest.MonkeyPatch, push: int, before: bool) -> None:
    """Kill the runner at a push of the studio, before or after its execution."""
    real, count = VirtualSculptingRobot.push, iter(range(1, 100))

    def push_or_die(self: VirtualSculptingRobot, given: Any) -> Any:
        last = next(count) == push
        if last and before:
            raise Killed
        measured = real(self, given)
        if last:
            raise Killed
        return measured

    monkeypatch.setattr(VirtualSculptingRobot, "push", push_or_die)


def test_sculpture_is_recorded_and_reduces_the_error(bundle: Path, tmp_path: Path) -> None:
    state = sculpted(commissioned(bundle), tmp_path / "s")
    pushes = len(state.progress.actions)
    assert state.stopped is not None and 1 <= pushes <= 4
    assert state.progress.values[-1] < state.progress.values[0]
    read = read_table(tmp_path / "s/pushes", CONTRACT)
    assert read.table.num_rows == pushes and not read.quarantined
    assert np.allclose(np.array(read.table["action"].to_pylist()), np.array(state.progress.actions), atol=1e-6)
    summary = json.loads((tmp_path / "s/sculpture.json").read_text())
    assert summary["actions"] == pushes and summary["error_3d_mm2"]["after"] != summary["error_3d_mm2"]["before"]
    assert all((tmp_path / f"s/{name}.png").is_file() for name in module.HEIGHTS)
    # Resuming a finished sculpture changes nothing.
    again = sculpted(commissioned(bundle), tmp_path / "s", resume=True)
    assert again.stopped == state.stopped and len(again.progress.actions) == pushes


def test_sculpture_resumed_after_a_stop_equals_an_uninterrupted_one(bundle: Path, tmp_path: Path) -> None:
    whole = sculpted(commissioned(bundle), tmp_path / "whole")
    control = Control()
    control.send("stop")
    with pytest.raises(Ended, match="--resume"):
        run_sculpture(commissioned(bundle), tmp_path / "parts", resume=False, control=control, progress=Progress())
    commission = read_clay_commission(tmp_path / "parts")
    assert commission == commissioned(bundle)
    parts = sculpted(commission, tmp_path / "parts", resume=True)
    assert parts.sessions == 2
    np.testing.assert_array_equal(np.array(parts.progress.actions), np.array(whole.progress.actions))
    np.testing.assert_array_equal(parts.progress.heights_m[-1], whole.progress.heights_m[-1])


@pytest.mark.parametrize("before", [True, False])
def test_sculpture_killed_during_a_push_scans_again_on_resume(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: bool
) -> None:
    with monkeypatch.context() as patched, pytest.raises(Killed):
        killed_at(patched, 2, before)
        sculpted(commissioned(bundle), tmp_path / "s")
    saved = load_sculpture(tmp_path / "s")
    assert saved.progress.pending and len(saved.progress.actions) == 1
    state = sculpted(commissioned(bundle), tmp_path / "s", resume=True)
    assert state.stopped is not None and state.progress.values[-1] < state.progress.values[0]
    # The unconfirmed push has no row; the next one starts from the clay as it left it.
    read = read_table(tmp_path / "s/pushes", CONTRACT)
    assert read.table.num_rows == len(state.progress.actions) and not read.quarantined
    moved = np.abs(state.progress.heights_m[1] - saved.progress.heights_m[1]).max()
    assert moved > 1e-3  # the push was in the journal, so the studio executed it either way


def test_commission_takes_the_bundles_settings_where_the_command_says_nothing(bundle: Path) -> None:
    left = clay_commission_of(bundle, "foam", "T")
    assert (left.depth_m, left.actions, left.seed) == (0.0035, 60, SETTINGS.planner.seed)
    given = clay_commission_of(bundle, "foam", "T", depth_m=0.002, actions=5, seed=9)
    assert (given.depth_m, given.actions, given.seed) == (0.002, 5, 9)


def test_sculpture_rejects_unknown_material_letter_and_used_folder(bundle: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no push model of 'sand'; it has: foam"):
        clay_commission_of(bundle, "sand", "A")
    with pytest.raises(GoalError, match="cannot be drawn"):
        clay_commission_of(bundle, "foam", "Ä")
    sculpted(commissioned(bundle, actions=1), tmp_path / "s")
    with pytest.raises(ContractError, match="was begun"):
        sculpted(commissioned(bundle, actions=1), tmp_path / "s")


def test_letter_reliefs_are_sunken_centred_and_distinct() -> None:
    letters = {text: sunken_letters(text, (64, 96), 0.7, 1.0) for text in "AHT"}
    for relief in letters.values():
        assert relief.shape == (64, 96) and relief.min() < -0.9 and relief.max() < 1e-6
        inked = np.flatnonzero((relief < -0.5).any(axis=1))
        assert 0.6 * 64 < np.ptp(inked) + 1 <= 0.72 * 64
    assert np.abs(letters["A"] - letters["H"]).mean() > 0.02
    # A T is symmetric left to right, and not top to bottom.
    t = letters["T"]
    assert np.abs(t - t[:, ::-1]).mean() < 0.3 * np.abs(t - t[::-1]).mean()

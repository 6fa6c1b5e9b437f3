"""A sculpture by the lean runner: its record, going on after it was killed, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
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
from pentimento.robots.sculpting_virtual import VirtualSculptingRobot
from tests.bundle.tiny_bundle import write_tiny_bundle
from tests.control.sculpting_bundle import FACTS, add_clay
from tests.planning.pushes.clay import PressedClay
from tests.planning.pushes.settings import CONFIG


@pytest.fixture
def bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A bundle with a push model of foam, whose graphs are stood in for by the tests' own model of clay."""
    folder = add_clay(write_tiny_bundle(tmp_path / "bundle"))
    monkeypatch.setattr(module, "GraphClay", lambda *_: PressedClay(window_m=np.array(FACTS.window_m)))
    monkeypatch.setattr(module, "_PLANNER", replace(CONFIG, edge_m=0.03, horizon=2, candidates=12, iterations=2))
    return folder


def commissioned(bundle: Path, actions: int = 6) -> ClayCommission:
    return clay_commission_of(bundle, "foam", "T", actions=actions, seed=3)


def made(commission: ClayCommission, folder: Path, resume: bool = False) -> SculptureState:
    return run_sculpture(commission, folder, resume=resume, control=Control(), progress=Progress())


class Killed(BaseException):
    """As if the process were gone: nothing catches it."""


def killed_at(monkeypatch: pytest.MonkeyPatch, push: int, before: bool) -> None:
    """Kill the runner at a push of the studio, before it is made or after."""
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


def test_it_is_recorded_and_the_clay_comes_nearer(bundle: Path, tmp_path: Path) -> None:
    state = made(commissioned(bundle), tmp_path / "s")
    pushes = len(state.progress.actions)
    assert state.stopped is not None and 1 <= pushes <= 6
    assert state.progress.values[-1] < state.progress.values[0]
    read = read_table(tmp_path / "s/pushes", CONTRACT)
    assert read.table.num_rows == pushes and not read.quarantined
    assert np.allclose(np.array(read.table["action"].to_pylist()), np.array(state.progress.actions), atol=1e-6)
    told = json.loads((tmp_path / "s/sculpture.json").read_text())
    assert told["actions"] == pushes and told["error_3d_mm2"]["after"] != told["error_3d_mm2"]["before"]
    assert all((tmp_path / f"s/{name}.png").is_file() for name in module.HEIGHTS)
    # It is done: going on changes nothing.
    again = made(commissioned(bundle), tmp_path / "s", resume=True)
    assert again.stopped == state.stopped and len(again.progress.actions) == pushes


def test_stopped_between_two_pushes_it_ends_as_if_nothing_had_happened(bundle: Path, tmp_path: Path) -> None:
    whole = made(commissioned(bundle), tmp_path / "whole")
    control = Control()
    control.send("stop")
    with pytest.raises(Ended, match="--resume"):
        run_sculpture(commissioned(bundle), tmp_path / "parts", resume=False, control=control, progress=Progress())
    commission = read_clay_commission(tmp_path / "parts")
    assert commission == commissioned(bundle)
    parts = made(commission, tmp_path / "parts", resume=True)
    assert parts.sessions == 2
    np.testing.assert_array_equal(np.array(parts.progress.actions), np.array(whole.progress.actions))
    np.testing.assert_array_equal(parts.progress.heights_m[-1], whole.progress.heights_m[-1])


@pytest.mark.parametrize("before", [True, False])
def test_killed_in_a_push_it_looks_again(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: bool
) -> None:
    with monkeypatch.context() as patched, pytest.raises(Killed):
        killed_at(patched, 2, before)
        made(commissioned(bundle), tmp_path / "s")
    left = load_sculpture(tmp_path / "s")
    assert left.progress.pending and len(left.progress.actions) == 1
    state = made(commissioned(bundle), tmp_path / "s", resume=True)
    assert state.stopped is not None and state.progress.values[-1] < state.progress.values[0]
    # The push that nobody heard of is no row; the clay that it left is what the next one starts from.
    read = read_table(tmp_path / "s/pushes", CONTRACT)
    assert read.table.num_rows == len(state.progress.actions) and not read.quarantined
    moved = np.abs(state.progress.heights_m[1] - left.progress.heights_m[1]).max()
    assert moved > 1e-3  # the push was in the journal: the studio made it, either way


def test_what_does_not_fit_is_a_sentence_and_leaves_no_folder(bundle: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no push model of 'sand'; it has: foam"):
        clay_commission_of(bundle, "sand", "A")
    with pytest.raises(GoalError, match="cannot be drawn"):
        clay_commission_of(bundle, "foam", "Ä")
    made(commissioned(bundle, actions=1), tmp_path / "s")
    with pytest.raises(ContractError, match="was begun"):
        made(commissioned(bundle, actions=1), tmp_path / "s")


def test_letters_are_sunken_and_unlike_each_other() -> None:
    letters = {text: sunken_letters(text, (64, 96), 0.7, 1.0) for text in "AHT"}
    for relief in letters.values():
        assert relief.shape == (64, 96) and relief.min() < -0.9 and relief.max() < 1e-6
        inked = np.flatnonzero((relief < -0.5).any(axis=1))
        assert 0.6 * 64 < np.ptp(inked) + 1 <= 0.72 * 64
    assert np.abs(letters["A"] - letters["H"]).mean() > 0.02
    # A T is alike left and right, and not up and down.
    t = letters["T"]
    assert np.abs(t - t[:, ::-1]).mean() < 0.3 * np.abs(t - t[::-1]).mean()

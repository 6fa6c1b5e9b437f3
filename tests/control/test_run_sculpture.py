"""A sculpture by the lean runner: its recording, its resumption, and refused arguments."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pentimento.bundle.reader import BundleError, open_bundle
from pentimento.cli.main import main
from pentimento.contracts.codec import to_plain
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import encode_png, read_image
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control import run_sculpture as module
from pentimento.control.checkpoint import SculptureState, load_sculpture
from pentimento.control.commission import ClayCommission, ClayGoal, read_clay_commission
from pentimento.control.person import Control, Order, Progress
from pentimento.control.run_sculpture import Ended, clay_commission_of, run_sculpture
from pentimento.control.sculptor import Sculptor
from pentimento.dynamics.pushes.measured import load_pushes
from pentimento.dynamics.pushes.measured_scene import scene_of
from pentimento.goals3d.fonts import installed_fonts
from pentimento.planning.pushes.analytic.correction import Correction, Range
from pentimento.planning.pushes.analytic.mechanisms.work_hardening import WorkHardening
from pentimento.planning.pushes.analytic.model import BASE, START, AnalyticPush
from pentimento.planning.pushes.goal import GoalError, sunken_letters
from pentimento.planning.pushes.memory import PushMemory
from pentimento.robots.virtual import VirtualSculptingRobot
from tests.bundle.tiny_bundle import change, write_tiny_bundle
from tests.control.sculpting_bundle import FACTS, PIXELS, SETTINGS, add_clay, add_feeder
from tests.planning.pushes.clay import PressedClay

T = ClayGoal("letter", "T")
SERIF = next(installed_fonts())
HALF_WIDTH_M = 0.008
MODEL = AnalyticPush(0.012, np.array([START[name] for name in BASE]), ())


@pytest.fixture
def bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A bundle with a push model of foam, with the tests' model of clay in place of its graphs."""
    folder = add_clay(write_tiny_bundle(tmp_path / "bundle"))
    monkeypatch.setattr(module, "clay_members", lambda *_: (PressedClay(window_m=np.array(FACTS.window_m)),))
    return folder


def commissioned(bundle: Path, actions: int = 4) -> ClayCommission:
    return clay_commission_of(bundle, "foam", T, actions=actions, seed=3)


def sculpted(commission: ClayCommission, folder: Path, resume: bool = False) -> SculptureState:
    return run_sculpture(commission, folder, resume=resume, control=Control(), progress=Progress())


def test_replay_of_a_sculpture_says_that_it_is_one_and_where_its_pictures_are(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    sculpted(commissioned(bundle, 1), out)
    assert main(["replay", str(out)]) == 1
    said = capsys.readouterr().err
    assert f"{out} is a sculpture" in said and str(out / "sculpture.png") in said and (out / "sculpture.png").is_file()


class Killed(BaseException):
    """Stands for the end of the process: nothing catches it."""


class Stopping(Control):
    """A person who stops after some pushes."""

    def __init__(self, after: int) -> None:
        super().__init__()
        self._left = after

    def poll(self) -> Order | None:
        self._left -= 1
        if self._left < 0:
            self.send("stop")
        return super().poll()


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


def test_scans_may_be_finer_than_the_push_model_s_maps(bundle: Path, tmp_path: Path) -> None:
    commission = clay_commission_of(bundle, "foam", T, actions=2, seed=3, scan_pixels=2 * PIXELS)
    control = Control()
    control.send("stop")
    with pytest.raises(Ended):
        run_sculpture(commission, tmp_path / "s", resume=False, control=control, progress=Progress())
    state = sculpted(read_clay_commission(tmp_path / "s") or commission, tmp_path / "s", resume=True)
    assert {each.shape for each in (*state.progress.heights_m, state.goal_m)} == {(2 * PIXELS, 2 * PIXELS)}
    assert len(state.progress.actions) >= 1 and state.progress.values[-1] < state.progress.values[0]
    saved = load_sculpture(tmp_path / "s").progress  # the first and the last map, however many there were
    np.testing.assert_array_equal(saved.heights_m, [state.progress.heights_m[0], state.progress.heights_m[-1]])
    with pytest.raises(ConfigError, match="4 pixels a side cannot be planned on"):
        clay_commission_of(bundle, "foam", T, scan_pixels=4)


def test_raised_goal_is_built_of_pellets_and_goes_on_after_a_stop(bundle: Path, tmp_path: Path) -> None:
    add_feeder(bundle)
    commission = clay_commission_of(bundle, "foam", T, actions=6, seed=3, raised_m=0.004)
    whole = sculpted(commission, tmp_path / "whole")
    assert whole.progress.values[-1] < 0.9 * whole.progress.values[0]
    rows = read_table(tmp_path / "whole/pushes", CONTRACT).table.to_pylist()
    assert "place" in {row["kind"] for row in rows}
    with pytest.raises(Ended):
        run_sculpture(commission, tmp_path / "cut", resume=False, control=Stopping(2), progress=Progress())
    resumed = sculpted(commission, tmp_path / "cut", resume=True)
    np.testing.assert_array_equal(resumed.progress.heights_m[-1], whole.progress.heights_m[-1])


def test_raised_goal_without_a_feeder_is_refused(bundle: Path) -> None:
    with pytest.raises(ConfigError, match="Pushes only lower the foam, and the bundle has no feeder"):
        clay_commission_of(bundle, "foam", T, seed=3, raised_m=0.004)


def test_bundle_with_a_feeder_and_no_place_model_is_refused(bundle: Path) -> None:
    change(bundle, sculpting={"clay_foam": to_plain(replace(SETTINGS, feeder="pellets"))})
    with pytest.raises(BundleError, match=r"feeders/pellets\.toml"):
        open_bundle(bundle)


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


def test_sculpture_killed_before_it_plans_again_equals_an_uninterrupted_one(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = sculpted(commissioned(bundle), tmp_path / "whole")
    with monkeypatch.context() as patched, pytest.raises(Killed):
        patched.setattr(Sculptor, "replan", lambda *_: killed())
        sculpted(commissioned(bundle), tmp_path / "parts")
    assert load_sculpture(tmp_path / "parts").progress.due == 0
    parts = sculpted(commissioned(bundle), tmp_path / "parts", resume=True)
    assert parts.stopped == whole.stopped
    np.testing.assert_array_equal(np.array(parts.progress.actions), np.array(whole.progress.actions))


def test_a_push_that_was_recorded_and_not_confirmed_has_no_row(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = module.write_push

    def record_and_die(folder: Path, row: dict[str, Any]) -> None:
        real(folder, row)
        killed()

    with monkeypatch.context() as patched, pytest.raises(Killed):
        patched.setattr(module, "write_push", record_and_die)
        sculpted(commissioned(bundle), tmp_path / "s")
    state = sculpted(commissioned(bundle), tmp_path / "s", resume=True)
    orders = read_table(tmp_path / "s/pushes", CONTRACT).table["order"].to_pylist()
    assert orders == list(range(len(state.progress.actions)))
    assert read_image(tmp_path / "s/sculpture.png").ndim == 3


def killed() -> None:
    """End the process."""
    raise Killed


def test_commission_takes_the_bundles_settings_where_the_command_says_nothing(bundle: Path) -> None:
    left = clay_commission_of(bundle, "foam", T)
    assert (left.depth_m, left.actions, left.seed) == (0.0035, 60, SETTINGS.planner.seed)
    given = clay_commission_of(bundle, "foam", T, depth_m=0.002, actions=5, seed=9)
    assert (given.depth_m, given.actions, given.seed) == (0.002, 5, 9)


def test_sculpture_rejects_unknown_material_letter_and_used_folder(bundle: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no push model of 'sand'; it has: foam"):
        clay_commission_of(bundle, "sand", T)
    sculpted(commissioned(bundle, actions=1), tmp_path / "s")
    with pytest.raises(ContractError, match="was begun"):
        sculpted(commissioned(bundle, actions=1), tmp_path / "s")


def test_a_preview_is_written_before_anything_moves(bundle: Path, tmp_path: Path) -> None:
    control = Control()
    control.send("stop")
    with pytest.raises(Ended):
        run_sculpture(commissioned(bundle), tmp_path / "s", resume=False, control=control, progress=Progress())
    assert not (tmp_path / "s/pushes").exists()
    preview = read_image(tmp_path / "s" / module.PREVIEW).astype(int)
    clay, goal = np.split(preview, 2, axis=1)
    assert clay.shape == (8 * PIXELS, 8 * PIXELS, 3)
    changed = np.abs(goal - clay).max(axis=2) > 10
    assert changed[:, :PIXELS].mean() < 0.02 < changed[2 * PIXELS : -2 * PIXELS, 2 * PIXELS : -2 * PIXELS].mean()


def test_the_record_tells_the_diagnosis_what_was_pushed_before(bundle: Path, tmp_path: Path) -> None:
    """Rows of the runner are measured pushes with a history, which is the memory that the plan had."""
    commission = commissioned(bundle)
    with pytest.raises(Ended):
        run_sculpture(commission, tmp_path / "s", resume=False, control=Stopping(2), progress=Progress())
    state = sculpted(commission, tmp_path / "s", resume=True)
    table = read_table(tmp_path / "s/pushes", CONTRACT).table
    samples, _ = load_pushes(table)
    assert len(set(samples.session)) == 1 and len(samples.action) >= 3
    np.testing.assert_array_equal(samples.covariates["pushes_since_reset"], np.arange(len(samples.action)))
    assert (np.diff(samples.covariates["t_start_s"]) > 0).all()
    scene = scene_of(samples, HALF_WIDTH_M)
    assert scene.history_known and not scene.worked[0].any()
    recorded = {"dwell_s": Range(0.0, 0.5, 1.0)}
    hardening = Correction(MODEL.plus(WorkHardening(np.array([0.3, 0.8]), {})), MODEL, HALF_WIDTH_M, recorded)
    last = len(samples.action) - 1
    memory = PushMemory(tuple(state.progress.actions[:last]), {})
    planned = hardening.planned(samples.before[last], np.array(FACTS.window_m), samples.action[last:], memory)
    np.testing.assert_allclose(planned, hardening.of(scene)[last:], atol=2e-6)
    assert np.abs(planned).max() > 1e-5


GOALS = ("mesh", "heights", "image", "letter")


def goal_file(kind: str, folder: Path) -> ClayGoal:
    """A square hole, or a letter as wide as high, as each kind of goal."""
    grey = np.full((20, 20), 200, np.uint8)
    grey[6:14, 6:14] = 20
    match kind:
        case "mesh":
            corners = [(x, y, 0.0 if 0.3 < x < 0.7 and 0.3 < y < 0.7 else 1.0) for x, y in np.ndindex(11, 11)]
            lines = [f"v {x / 10} {y / 10} {-1 if 3 <= x <= 7 and 3 <= y <= 7 else 0}" for x, y, _ in corners]
            faces = [(11 * x + y + 1, 11 * x + y + 12, 11 * x + y + 13, 11 * x + y + 2) for x, y in np.ndindex(10, 10)]
            (folder / "hole.obj").write_text("\n".join([*lines, *("f {} {} {} {}".format(*face) for face in faces)]))
            return ClayGoal("mesh", str(folder / "hole.obj"), up="z")
        case "heights":
            heights = grey / 1e5
            heights[0, 3] = np.nan
            np.save(folder / "hole.npy", heights)
            return ClayGoal("heights", str(folder / "hole.npy"))
        case "image":
            (folder / "hole.png").write_bytes(encode_png(np.dstack([grey] * 3)))
            return ClayGoal("image", str(folder / "hole.png"))
        case _:
            return ClayGoal("letter", "Ж")  # in an installed font


@pytest.mark.parametrize("kind", GOALS)
def test_every_kind_of_goal_is_fitted_to_the_clay(bundle: Path, tmp_path: Path, kind: str) -> None:
    commission = clay_commission_of(bundle, "foam", goal_file(kind, tmp_path), actions=1, seed=3)
    state = sculpted(commission, tmp_path / "s")
    assert read_clay_commission(tmp_path / "s") == commission
    clay, goal = state.progress.heights_m[0], state.goal_m
    border = round(SETTINGS.fit.border_share * PIXELS)
    assert np.abs(goal[:border] - clay[:border]).max() < 1e-3  # two scans with their noise
    low = goal < (goal.min() + goal.max()) / 2
    rows, columns = np.nonzero(low)
    assert abs(rows.mean() - PIXELS / 2) < 1.5 and abs(columns.mean() - PIXELS / 2) < 1.5  # the hole is in the middle
    assert 0.03 < low.mean() < 0.6
    assert clay.mean() - SETTINGS.fit.depth_m - 1e-4 <= goal.min() < clay.mean() - 1e-3  # as deep as the tools reach


def test_goals_of_8_bits_and_thin_clay_are_told(tmp_path: Path) -> None:
    grey = np.arange(0, 240, 10, dtype=np.uint8).reshape(4, 6)
    Image.fromarray(grey).save(tmp_path / "grey.png")
    told: list[str] = []
    goal = ClayGoal("heights", str(tmp_path / "grey.png"))
    commission = ClayCommission("", "", "foam", "foam", goal, 0.01, 1, 0, 48)
    thin = np.full((48, 48), 0.009, np.float32)
    heights = module._goal(commission, SETTINGS, thin, (0.2, 0.2), tell=told.append)
    assert "has 8 bits: its heights are in 256 steps" in told[0]
    assert "9.0 mm high on average, so the goal is 4.0 mm deep instead of 10.0 mm" in told[1]
    assert heights.min() >= module.MIN_CLEARANCE_M - 1e-6  # so that the envelope lets the tool reach it
    with pytest.raises(GoalError, match=r"2\.0 mm high, too thin"):
        module._goal(commission, SETTINGS, thin - np.float32(0.007), (0.2, 0.2), tell=told.append)


@pytest.mark.parametrize(
    ("goal", "sentence"),
    [
        (ClayGoal("letter", "山", font=str(SERIF)), r"has no character '山' \(CJK UNIFIED IDEOGRAPH-5C71\)"),
        (ClayGoal("letter", "A", font="nowhere.ttf"), "nowhere.ttf cannot be read as a font"),
        (ClayGoal("letter", " "), "cannot be drawn"),
        (ClayGoal("mesh", "face.step"), r"is no mesh file; give one that ends in \.stl, \.obj, \.ply"),
        (ClayGoal("mesh", "nowhere.stl"), "There is no goal 'nowhere.stl'"),
        (ClayGoal("heights", "nowhere.npy"), "There is no goal 'nowhere.npy'"),
        (ClayGoal("image", "face.stl"), "is no picture; give it with --goal-mesh"),
    ],
)
def test_a_goal_that_cannot_be_is_refused_before_there_is_a_folder(bundle: Path, goal: ClayGoal, sentence: str) -> None:
    with pytest.raises(GoalError, match=sentence):
        clay_commission_of(bundle, "foam", goal)


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

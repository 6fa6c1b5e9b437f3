"""Tests of `pentimento calibrate` with a simulated plotter."""

from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import cv2
import pytest

from pentimento.calibration.calibrate import CHART_M
from pentimento.calibration.colour_chart import find_colours
from pentimento.calibration.lens import SQUARE_M, SQUARES
from pentimento.cli.calibrate import PRINT_PX_PER_M, calibrate_rig, residual_sentence, write_prints, yes_at_terminal
from pentimento.contracts.errors import CalibrationError, ConfigError
from pentimento.contracts.markers import DICTIONARY
from pentimento.control import open_robot as opening
from pentimento.robots.calibration import calibrated, fresh_calibrations, read_calibration
from pentimento.robots.rig import load_rig
from pentimento.robots.simulated_grbl import SimulatedGrbl
from tests.robots.small_plotter import small_plotter


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    points = EntryPoints([EntryPoint("grbl", "pentimento.robots.grbl:connect", opening.DRIVERS)])
    monkeypatch.setattr(opening, "entry_points", lambda group: points.select(group=group))


def plotter(tmp_path: Path) -> tuple[SimulatedGrbl, Path, list[str]]:
    """A simulated plotter, its rig file, and what the person was asked."""
    grbl = SimulatedGrbl(hurry=300)
    path = tmp_path / "rig.toml"
    path.write_text(small_plotter(grbl.port, (300, 200)))
    return grbl, path, []


def test_touch_calibration_of_a_plotter_recovers_the_paper_plane(tmp_path: Path) -> None:
    """The sheet is 1.2 mm higher than the rig file says, and rises by 2 mm over the canvas's width."""

    def paper_mm(x_mm: float, y_mm: float) -> float:
        return -10 + 1.2 + 2 * (x_mm - 20) / 300

    grbl, path, asked = plotter(tmp_path)
    seen = 0

    def person(question: str) -> bool:
        """Looks at what the pen has done since the last question."""
        nonlocal seen
        since, seen = grbl.trace[seen:], len(grbl.trace)
        return any(z <= paper_mm(x, y) for x, y, z, _ in since)

    try:
        found = calibrate_rig(str(path), "touch", "marker", folder=tmp_path / "cal", ask=asked.append, ask_yes=person)
    finally:
        grbl.close()
    assert "leaves" in residual_sentence(found) and "at most 0.0003 m" in residual_sentence(found)
    assert len(asked) == 1 and "Fit the marker" in asked[0]
    rig = load_rig(path)
    fresh = fresh_calibrations(tmp_path / "cal", rig, found.made_unix_s + 60, 3600.0)
    a, b, c = calibrated(rig, fresh["touch"]).surface
    assert a == pytest.approx(1.2e-3, abs=2e-4) and 0.3 * b == pytest.approx(2e-3, abs=2e-4) and abs(c) < 1e-9
    path.write_text(path.read_text().replace("-10 mm", "-10.5 mm"))
    with pytest.raises(CalibrationError, match="its file was changed"):
        fresh_calibrations(tmp_path / "cal", load_rig(path), found.made_unix_s + 60, 3600.0)


def test_poor_calibration_is_written_and_refused(tmp_path: Path) -> None:
    """A person who answers by another sheet at each place."""

    def paper_mm(x_mm: float, y_mm: float) -> float:
        return -9 if (x_mm > 150) == (y_mm > 110) else -7.8

    grbl, path, asked = plotter(tmp_path)
    seen = 0

    def person(question: str) -> bool:
        nonlocal seen
        since, seen = grbl.trace[seen:], len(grbl.trace)
        return any(z <= paper_mm(x, y) for x, y, z, _ in since)

    try:
        with pytest.raises(CalibrationError, match="leaves"):
            calibrate_rig(str(path), "touch", "marker", folder=tmp_path / "cal", ask=asked.append, ask_yes=person)
    finally:
        grbl.close()
    assert read_calibration(tmp_path / "cal", "touch").residual > 3e-4


def test_rejects_calibration_of_a_file_rig(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nothing to calibrate"):
        calibrate_rig("plotter_on_file", "touch", "marker", folder=tmp_path, ask=lambda _: None, ask_yes=lambda _: True)


def test_asks_again_until_yes_or_no(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = iter(["", "perhaps", " Y ", "no"])
    monkeypatch.setattr("builtins.input", lambda _: next(answers))
    assert yes_at_terminal("Is there a mark?") is True
    assert yes_at_terminal("Is there a mark?") is False
    assert next(answers, None) is None


def test_prints_have_true_size_and_are_detected(tmp_path: Path) -> None:
    paths = write_prints(tmp_path, (0.3, 0.2))
    assert len(paths) == 10
    images = {path.name: cv2.imread(str(path)) for path in paths}
    board = images["charuco_board.png"]
    assert board.shape[1] / PRINT_PX_PER_M == pytest.approx(SQUARES[0] * SQUARE_M)
    assert images["colour_chart.png"].shape[1::-1] == tuple(round(side * PRINT_PX_PER_M) for side in CHART_M)
    chart = cv2.cvtColor(images["colour_chart.png"], cv2.COLOR_BGR2RGB)
    assert find_colours(chart).residual < 0.3
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    for number in range(8):
        page = cv2.copyMakeBorder(images[f"marker_{number}.png"], 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=(255,) * 3)
        _, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(page)
        assert ids.ravel().tolist() == [number]

"""Every calibration in the studio: the camera, the light, the sheet are set wrong, and what was set is found again."""

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from pentimento.calibration.calibrate import (
    CHART_M,
    calibrate,
    calibrate_canvas,
    calibrate_colours,
    calibrate_touch,
    camera_of,
    colours_of,
    lens_of,
    marks_on_photos,
    marks_seen_by_a_person,
)
from pentimento.calibration.colour_chart import COLUMNS, ROWS, chart_image, true_colours
from pentimento.calibration.observe import calibrate_camera, rectify
from pentimento.contracts.colour import delta_e_2000, srgb_to_lab, srgb_to_linear, to_float, to_uint8
from pentimento.contracts.errors import CalibrationError
from pentimento.contracts.markers import markers_around
from pentimento.contracts.observations import Photo
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.robots.calibration import calibrated, read_calibration, require_fresh
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.camera import make_optics
from pentimento.studio.strokes.sheet import CELLS_PER_M, surface_height_m
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import World, load_world
from tests.calibration import test_lens as lens_studio
from tests.robots.machines import make_rig

CANVAS_M = (0.3, 0.2)
RIG = make_rig(palette=None)
NOW_S = 1.7e9
MARKER = load_tool("marker")


def world(camera: dict[str, object] | None = None, paper: dict[str, object] | None = None, **effects: float) -> World:
    """The marker's world without any effect but the ones named."""
    plain = load_world("marker")
    none = {field.name: 0.0 for field in dataclasses.fields(plain.effects)}
    return dataclasses.replace(
        plain,
        camera=dataclasses.replace(plain.camera, **(camera or {})),  # type: ignore[arg-type]
        paper=dataclasses.replace(plain.paper, **(paper or {})),  # type: ignore[arg-type]
        effects=dataclasses.replace(plain.effects, **(none | effects)),
    )


# Canvas


@pytest.mark.parametrize(
    "camera",
    [{"rotation_rad": 0.08, "keystone": -0.06}, {"rotation_rad": -0.05, "keystone": 0.09, "pixels_per_m": 2200.0}],
)
def test_rotated_camera_is_registered_within_half_a_pixel(camera: dict[str, object]) -> None:
    """Against the studio's own table of where each pixel looks, over the whole canvas."""
    turned = world(camera)
    found = camera_of(calibrate_canvas(Studio(turned, 0).photo(), None, RIG, NOW_S))
    optics = make_optics(turned.camera, turned.effects, CANVAS_M)
    margin_m = turned.camera.margin_m
    rows, columns = np.mgrid[20 : optics.row.shape[0] - 20 : 23, 20 : optics.row.shape[1] - 20 : 31]
    x_m = (optics.column[rows, columns] + 0.5) / CELLS_PER_M - margin_m
    y_m = CANVAS_M[1] + margin_m - (optics.row[rows, columns] + 0.5) / CELLS_PER_M
    miss_px = found.to_camera(np.stack((x_m, y_m), axis=-1)) - np.stack((columns, rows), axis=-1)
    assert np.linalg.norm(miss_px, axis=-1).max() < 0.5


def test_a_canvas_seen_through_the_studio_s_lens_is_still_fresh() -> None:
    found = calibrate_canvas(Studio(load_world("marker"), 0).photo(), None, RIG, NOW_S)
    require_fresh(found, RIG, NOW_S, 60.0)
    assert found.values["straightened"] is False


# Colour


def chart_in(studio: Studio) -> None:
    """Lay the printed chart on the studio's sheet."""
    width, height = (round(side * CELLS_PER_M) for side in CHART_M)
    chart = srgb_to_linear(to_float(cv2.resize(chart_image(40), (width, height), interpolation=cv2.INTER_AREA)))
    rows = studio._below.shape[0]
    studio._below[rows - height : rows, :width] = chart
    studio._sheet_view()[:] = studio._below


@pytest.mark.parametrize(
    "camera",
    [
        {"white_balance": (0.55, 1.0, 0.75), "gain": 0.9},
        {"white_balance": (1.0, 0.8, 0.6), "exposure_s": 0.007},
    ],
)
def test_a_wrong_white_balance_and_exposure_are_taken_out(camera: dict[str, object]) -> None:
    """To 1 ΔE2000 on colours that are not on the chart; uncorrected they are 7 and more apart."""
    studio = Studio(world(camera), 0)
    chart_in(studio)
    photo = studio.photo()
    place = camera_of(calibrate_canvas(photo, None, RIG, NOW_S))
    found = calibrate_colours(photo, place, RIG, NOW_S)
    require_fresh(found, RIG, NOW_S, 60.0)
    assert found.residual < 1.5

    colours = to_uint8(np.random.default_rng(1).uniform(0.2, 0.85, (ROWS, COLUMNS, 3)))
    width, height = (round(side * CELLS_PER_M) for side in CHART_M)
    painted = cv2.resize(colours, (width, height), interpolation=cv2.INTER_NEAREST)
    rows = studio._below.shape[0]
    studio._below[rows - height : rows, :width] = srgb_to_linear(to_float(painted))
    studio._sheet_view()[:] = studio._below
    seen = rectify(studio.photo(), place, (0.0, 0.0, *CHART_M), 500.0)
    middles = seen[5::10, 5::10]  # patches of 10 x 10 pixels
    true_lab = srgb_to_lab(to_float(colours))
    before = delta_e_2000(srgb_to_lab(to_float(middles)), true_lab)
    after = delta_e_2000(srgb_to_lab(to_float(true_colours(middles, colours_of(found)))), true_lab)
    assert after.mean() < 1 and before.mean() > 7


# Touch


def at_the_sheet(paper: dict[str, object]) -> tuple[World, GuardedRobot]:
    tilted = world({"pixels_per_m": 1500.0}, paper, canvas_tilt=1.0)
    guard = GuardedRobot(VirtualRobot(Studio(tilted, 3)), envelope_for(MARKER, CANVAS_M))
    guard.change_tool(MARKER)
    return tilted, guard


@pytest.mark.parametrize("paper", [{"tilt_m": (0.0006, -0.0005), "bow_m": 0.0}, {"tilt_m": (0.0, 0.0), "bow_m": 0.0}])
def test_a_sheet_that_lies_wrong_is_found(paper: dict[str, object]) -> None:
    """Its slope within 0.1 mm over the canvas; its height within 0.3 mm, since the nib's longest fibres touch first."""
    tilted, guard = at_the_sheet(paper)
    camera = calibrate_camera(guard.photo(), markers_around(CANVAS_M))
    found = calibrate_touch(guard, MARKER, RIG, marks_on_photos(guard, guard.photo, camera, None), lambda: NOW_S)
    require_fresh(found, RIG, NOW_S, 60.0)
    a, b, c = calibrated(RIG, found).surface
    places = np.array([[x, y] for x in (0.05, 0.15, 0.25) for y in (0.04, 0.1, 0.16)])
    miss_m = a + places @ [b, c] - surface_height_m(tilted.paper, tilted.effects, places)
    assert np.abs(miss_m).max() < 3e-4 and np.abs(miss_m - miss_m.mean()).max() < 1e-4


def test_a_sheet_s_bow_shows_in_the_residual_and_a_strong_one_is_refused() -> None:
    _, guard = at_the_sheet({"tilt_m": (0.0, 0.0), "bow_m": 0.0012})
    camera = calibrate_camera(guard.photo(), markers_around(CANVAS_M))
    found = calibrate_touch(guard, MARKER, RIG, marks_on_photos(guard, guard.photo, camera, None), lambda: NOW_S)
    with pytest.raises(CalibrationError, match="touch calibration leaves"):
        require_fresh(found, RIG, NOW_S, 60.0)


def test_touch_calibration_without_a_camera_asks_the_person() -> None:
    """The person sees marks up to 0.4 mm above the sheet as the rig file has it; the rig knew of 0.1 mm already."""
    sent: list[np.ndarray] = []

    class Noting:
        def move(self, path: np.ndarray) -> np.ndarray:
            sent.append(path)
            return path

    def person(question: str) -> bool:
        assert "x = " in question and "y = " in question
        return bool(sent[-1][0, 3] <= 4e-4)

    rig = make_rig(surface=(1e-4, 0.0, 0.0), palette=None)
    marked = marks_seen_by_a_person(Noting(), person)  # type: ignore[arg-type]
    found = calibrate_touch(Noting(), MARKER, rig, marked, lambda: NOW_S)  # type: ignore[arg-type]
    assert found.values["surface"] == pytest.approx([5e-4, 0, 0], abs=3e-5)
    envelope = envelope_for(MARKER, CANVAS_M)
    for path in sent:
        envelope.check_path(path)
    starts = np.array([path[0, 1:3] for path in sent])
    apart = np.linalg.norm(starts[:, None] - starts, axis=2) + np.eye(len(starts))
    assert apart.min() > 0.0035  # every line on a blank place


# The command


def test_the_kinds_build_on_each_other_and_end_as_files(tmp_path: Path) -> None:
    rig = make_rig(camera=0, palette=None)
    asked: list[str] = []

    def photograph() -> Photo:
        """The board in the person's hand, twelve times; then a black picture."""
        if len(asked) <= 12:
            return lens_studio.photograph(len(asked), 1.0)
        return Photo(np.zeros((lens_studio.SIZE[1], lens_studio.SIZE[0], 3), np.uint8), 0.01, 1.0, np.ones(3), 0.0)

    def run(kind: str) -> None:
        robot = at_the_sheet({})[1] if kind == "touch" else None
        calibrate(
            kind,
            rig,
            tmp_path,
            photograph=photograph,
            robot=robot,
            tool=MARKER,
            ask=asked.append,
            ask_yes=lambda _: True,
            clock=lambda: NOW_S,
        )  # type: ignore[arg-type]

    with pytest.raises(CalibrationError, match="no lens calibration"):
        run("canvas")
    run("lens")
    assert len(asked) == 12
    written = read_calibration(tmp_path, "lens")
    require_fresh(written, rig, NOW_S, 60.0)
    assert lens_of(written).frame_size_px == lens_studio.SIZE
    with pytest.raises(CalibrationError, match="0 of 8 markers"):
        run("canvas")
    with pytest.raises(CalibrationError, match="no canvas calibration"):
        run("touch")
    with pytest.raises(CalibrationError, match="This lens calibration has no"):
        camera_of(written)


def test_what_a_kind_needs_and_does_not_get_is_said(tmp_path: Path) -> None:
    def run(kind: str) -> None:
        calibrate(
            kind,
            RIG,
            tmp_path,
            photograph=None,
            robot=None,
            tool=MARKER,
            ask=lambda _: None,
            ask_yes=lambda _: True,
            clock=lambda: NOW_S,
        )  # type: ignore[arg-type]

    for kind in ("lens", "canvas", "colour"):
        with pytest.raises(CalibrationError, match="has no camera"):
            run(kind)
    with pytest.raises(CalibrationError, match="needs the robot"):
        run("touch")


def test_touch_calibration_at_human_pace_is_dated_when_it_ends(tmp_path: Path) -> None:
    """Half a minute for each answer."""
    sent: list[np.ndarray] = []
    now_s = NOW_S

    class Noting:
        def move(self, path: np.ndarray) -> np.ndarray:
            sent.append(path)
            return path

    def person(_: str) -> bool:
        nonlocal now_s
        now_s += 30.0
        return bool(sent[-1][0, 3] <= 4e-4)

    rig = make_rig(palette=None)
    calibrate(
        "touch", rig, tmp_path, photograph=None, robot=Noting(), tool=MARKER,  # type: ignore[arg-type]
        ask=lambda _: None, ask_yes=person, clock=lambda: now_s,
    )  # fmt: skip
    written = read_calibration(tmp_path, "touch")
    assert written.made_unix_s == now_s == NOW_S + 30 * len(sent) > NOW_S + 600
    require_fresh(written, rig, now_s, 60.0)


def test_a_lens_shows_in_the_canvas_s_residual() -> None:
    """A homography cannot follow a lens: the corners of the markers lie where it does not put them."""
    plain = calibrate_canvas(Studio(world(), 0).photo(), None, RIG, NOW_S).residual
    bent = calibrate_canvas(Studio(world(lens_distortion=2.0), 0).photo(), None, RIG, NOW_S).residual
    assert plain < 0.3 and bent > 2 * plain

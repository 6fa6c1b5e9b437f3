"""What the camera makes of the table."""

import cv2
import numpy as np
import pytest

from pentimento.contracts.markers import DICTIONARY, markers_around
from pentimento.studio.strokes.camera import make_optics
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world
from tests.studio.strokes.worlds import BLACK, straight, world_with


def _markers(frame: np.ndarray) -> dict[int, np.ndarray]:
    """Corners float[4,2] (column, row) of every marker found, by id."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(frame)
    return {int(i): c[0] for i, c in zip(np.ravel(ids), corners, strict=True)}


@pytest.mark.parametrize("name", ["plain", "round_brush", "marker"])
def test_all_markers_can_be_found(name: str) -> None:
    photo = Studio(load_world(name), 0).photo()
    assert sorted(_markers(photo.frame)) == list(markers_around((0.3, 0.2)).ids)


def test_a_stroke_is_where_the_markers_say() -> None:
    studio = Studio(world_with(), 0)
    before = studio.photo().frame.astype(float)
    studio.dip(BLACK)
    studio.stroke(straight(start=(0.06, 0.185), length_m=0.06))
    frame = studio.photo().frame
    found, layout = _markers(frame), markers_around((0.3, 0.2))
    metres = layout.corners_m().reshape(-1, 2)
    pixels = np.concatenate([found[i] for i in layout.ids])
    to_metres, _ = cv2.findHomography(pixels, metres)
    rows, columns = np.nonzero((before - frame).mean(axis=2) > 60)
    assert rows.max() < frame.shape[0] / 4
    xy = cv2.perspectiveTransform(np.column_stack([columns, rows]).astype(float)[None], to_metres)[0]
    assert xy.mean(axis=0) == pytest.approx((0.09, 0.185), abs=6e-4)


def _centre_and_corner(**strengths: float) -> tuple[float, float]:
    world = world_with(**strengths)
    light = make_optics(world.camera, world.effects, world.paper.size_m).light[..., 1]
    return float(light[light.shape[0] // 2, light.shape[1] // 2]), float(light[0, 0])


def test_without_effects_light_is_even() -> None:
    centre, corner = _centre_and_corner()
    assert centre == corner


def test_vignetting_darkens_the_corners_by_the_fourth_power_of_the_cosine() -> None:
    centre, corner = _centre_and_corner(vignetting=1.0)
    angle = load_world("plain").camera.field_angle_rad
    assert corner / centre == pytest.approx(np.cos(angle) ** 4, rel=1e-2)


def test_the_lamp_stands_at_one_side() -> None:
    world = world_with(illumination_gradient=1.0)
    light = make_optics(world.camera, world.effects, world.paper.size_m).light[..., 1]
    assert light[:, -1].mean() > light.mean() > light[:, 0].mean()


def test_the_lens_bends_what_lies_far_from_its_centre() -> None:
    plain, bent = (
        make_optics(w.camera, w.effects, w.paper.size_m) for w in (world_with(), world_with(lens_distortion=1.0))
    )
    shift = np.hypot(plain.column - bent.column, plain.row - bent.row)
    height, width = shift.shape
    assert shift[height // 2 - 20 : height // 2 + 20, width // 2 - 20 : width // 2 + 20].max() < 0.1
    assert shift[0, 0] > 5


def test_noise_is_new_in_each_photo_and_small() -> None:
    studio = Studio(world_with(), 0)
    first, second = studio.photo().frame.astype(float), studio.photo().frame.astype(float)
    spread = (first - second)[200:500, 300:700].std()
    assert 0.3 < spread < 4

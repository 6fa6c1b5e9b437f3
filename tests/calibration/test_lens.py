"""The lens, on photographs of the board by the studio's camera, whose lens is another formula than the one fitted."""

import dataclasses
import math

import cv2
import numpy as np
import pytest

from pentimento.calibration.lens import SQUARE_M, SQUARES, board_image, find_lens, straightened, through_lens
from pentimento.contracts.errors import CalibrationError
from pentimento.contracts.observations import Photo
from pentimento.robots.rig import rotation_of
from pentimento.studio.strokes.camera import Optics, _through_lens, expose
from pentimento.studio.strokes.world import load_world

SIZE = (640, 480)
HALF = 0.5 * math.hypot(*SIZE)
FOCAL = 1.6  # in half diagonals
CAMERA = dataclasses.replace(load_world("marker").camera, decentring=0.01, blur_m=0.0)
PER_M = 2000


def board() -> np.ndarray:
    """The printed board on grey cardboard, linear light [H, W, 3]."""
    printed = np.where(board_image(round(SQUARE_M * PER_M)) > 0, 0.8, 0.03).astype(np.float32)
    framed = cv2.copyMakeBorder(printed, 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=0.8)
    return np.repeat(cv2.copyMakeBorder(framed, 400, 400, 400, 400, cv2.BORDER_CONSTANT, value=0.3)[..., None], 3, 2)


SCENE = board()


def ideal(points_px: np.ndarray, strength: float) -> np.ndarray:
    """Directions [N, 2] (in half diagonals at unit radius) of points of the frame: the truth."""
    x = ((points_px[:, 0] - (SIZE[0] - 1) / 2) / HALF)[None, :]
    y = ((points_px[:, 1] - (SIZE[1] - 1) / 2) / HALF)[None, :]
    u, v = _through_lens(x, y, CAMERA, strength)
    return np.column_stack((np.ravel(u), np.ravel(v)))


def photograph(number: int, strength: float) -> Photo:
    """The board at some tilt and place, seen through a pinhole of focal length FOCAL and the studio's lens."""
    rng = np.random.default_rng(number)
    rotation = rotation_of(*rng.uniform(-0.55, 0.55, 2), rng.uniform(-0.4, 0.4))
    width_m, height_m = SQUARE_M * SQUARES[0], SQUARE_M * SQUARES[1]
    away_m = rng.uniform(0.42, 0.6)
    centre = np.array([*rng.uniform(-0.05, 0.05, 2), away_m])
    columns, rows = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float))
    directions = ideal(np.column_stack((columns.ravel(), rows.ravel())), strength)
    rays = np.column_stack((directions / FOCAL, np.ones(len(directions))))
    normal = rotation[:, 2]
    hits = rays * ((centre @ normal) / (rays @ normal))[:, None]
    on_board = (hits - centre) @ rotation[:, :2] + [width_m / 2, height_m / 2]
    where = (on_board * PER_M + 460 - 0.5).astype(np.float32).reshape(SIZE[1], SIZE[0], 2)
    optics = Optics(
        np.ascontiguousarray(where[..., 0]), np.ascontiguousarray(where[..., 1]),
        np.ones((SIZE[1], SIZE[0], 3), np.float32), 0.7,
    )  # fmt: skip
    frame = expose(SCENE, optics, CAMERA, rng)
    return Photo(frame, 0.008, 1.0, np.ones(3), 0.0)


def remaining_px(lens, strength: float) -> float:
    """RMS distance in the straightened frame from a pinhole's, whatever its focal length and centre: what lines see."""
    grid = np.stack(np.meshgrid(np.linspace(40, 600, 15), np.linspace(40, 440, 11)), axis=-1).reshape(-1, 2)
    found, true = through_lens(lens, grid), ideal(grid, strength)
    design = np.column_stack((true, np.ones(len(true))))
    solution, *_ = np.linalg.lstsq(design, found, rcond=None)
    return float(np.sqrt(np.mean(np.sum((design @ solution - found) ** 2, axis=1))))


@pytest.mark.parametrize("strength", [-2.0, 0.0, 2.0])
def test_a_lens_that_was_set_wrong_is_recovered_within_a_third_of_a_pixel(strength: float) -> None:
    """At strength 2 the frame's corners are off by 20 pixels."""
    photos = [photograph(number, strength) for number in range(12)]
    lens = find_lens(photos)
    assert lens.residual_px < 0.3
    assert remaining_px(lens, strength) < 0.33
    assert lens.matrix[0, 0] == pytest.approx(FOCAL * HALF, rel=0.02)
    assert lens.matrix[1, 1] == pytest.approx(FOCAL * HALF, rel=0.02)
    if strength:
        nothing = dataclasses.replace(lens, distortion=np.zeros(5))
        assert remaining_px(nothing, strength) > 10 * remaining_px(lens, strength)


def test_straightening_makes_the_board_s_edges_straight() -> None:
    strength = 3.0
    lens = find_lens([photograph(number, strength) for number in range(8)])
    photo = photograph(20, strength)
    bent, straight = (_bend_px(image) for image in (photo, straightened(photo, lens)))
    assert straight < 0.4 and straight < bent / 3


def _bend_px(photo: Photo) -> float:
    """Max RMS deviation of the board's rows of corners from a line."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    detector = cv2.aruco.CharucoDetector(cv2.aruco.CharucoBoard(SQUARES, SQUARE_M, 0.7 * SQUARE_M, dictionary))
    corners, ids, _, _ = detector.detectBoard(cv2.cvtColor(photo.frame, cv2.COLOR_RGB2GRAY))
    places, rows = corners.reshape(-1, 2), ids.ravel() // (SQUARES[0] - 1)
    bends = []
    for row in np.unique(rows):
        points = places[rows == row]
        if len(points) >= 6:
            bends.append(np.linalg.svd(points - points.mean(0), compute_uv=False)[1] / math.sqrt(len(points)))
    return max(bends)


def test_too_few_photographs_are_refused() -> None:
    blank = Photo(np.full((480, 640, 3), 90, np.uint8), 0.01, 1.0, np.ones(3), 0.0)
    with pytest.raises(CalibrationError, match="5 of 8 photographs"):
        find_lens([photograph(number, 0.0) for number in range(5)] + [blank] * 3)
    other = Photo(np.full((240, 320, 3), 90, np.uint8), 0.01, 1.0, np.ones(3), 0.0)
    with pytest.raises(CalibrationError, match="one camera"):
        find_lens([blank, other])


def test_a_photograph_of_another_size_is_refused() -> None:
    lens = find_lens([photograph(number, 1.0) for number in range(7)])
    with pytest.raises(CalibrationError, match="calibrate again"):
        straightened(Photo(np.zeros((10, 10, 3), np.uint8), 0.01, 1.0, np.ones(3), 0.0), lens)

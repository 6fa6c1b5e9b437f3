"""A photograph becomes the canvas's target in memory of the order of the photograph."""

import tracemalloc

import cv2
import numpy as np

from pentimento.contracts.colour import srgb_to_linear, to_float
from pentimento.planning.strokes.target import averaged_light, fit_to_canvas


def test_averaging_in_bands_is_the_average_of_the_whole() -> None:
    photo = np.random.default_rng(0).integers(0, 256, (301, 417, 3), np.uint8)
    whole = srgb_to_linear(to_float(photo).astype(np.float64))
    for shape in ((64, 96), (300, 417), (301, 20), (1, 1)):
        resized = cv2.resize(whole, shape[::-1], interpolation=cv2.INTER_AREA)
        np.testing.assert_allclose(averaged_light(photo, shape), resized, atol=1e-6)


def test_fitting_a_large_photograph_takes_little_memory() -> None:
    photo = np.full((3000, 4000, 3), 188, np.uint8)
    tracemalloc.start()
    fitted = fit_to_canvas(photo, (120, 160))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2 * photo.nbytes
    np.testing.assert_allclose(fitted, srgb_to_linear(np.array(188 / 255)), atol=1e-9)

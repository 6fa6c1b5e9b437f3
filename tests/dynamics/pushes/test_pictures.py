"""Clay is lit from the upper left, and errors have their colour."""

import numpy as np

from pentimento.dynamics.pushes.pictures import comparison, hillshade


def test_slopes_that_face_the_upper_left_are_lit() -> None:
    row, column = np.mgrid[:41, :41].astype(float) - 20
    bump = 3e-3 * np.exp(-(row**2 + column**2) / 60)
    shaded = hillshade(bump, 500.0).astype(int)
    flat = shaded[0, 0]
    assert shaded[15, 15] > flat > shaded[25, 25]  # row 15 is above the middle
    np.testing.assert_array_equal(shaded, shaded.T)


def test_too_high_is_red_and_too_low_is_blue_and_holes_are_white() -> None:
    flat = np.full((1, 8, 10), 0.04)
    predicted = flat.copy()
    predicted[0, 2, 3], predicted[0, 5, 6], predicted[0, 7, 9] = 0.043, 0.037, 0.05
    known = np.ones((1, 8, 10), dtype=bool)
    known[0, 7, 9] = False
    picture = comparison(flat, flat, predicted, known, 500.0)
    assert picture.shape == (8, 4 * 10 + 3 * 3, 3)
    error = picture[:, -10:].astype(int)
    assert error[2, 3, 0] > 2 * error[2, 3, 2]
    assert error[5, 6, 2] > 2 * error[5, 6, 0]
    assert (error[7, 9] == 255).all()
    assert (error[0, 0] == 255).all()

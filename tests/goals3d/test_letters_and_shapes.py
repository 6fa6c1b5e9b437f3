"""Letters and shapes stand upright, where they should, with their holes."""

import numpy as np
import pytest

from pentimento.goals3d.letters import letter_relief
from pentimento.goals3d.shapes import SHAPES, shape_relief
from pentimento.planning.pushes.goal import GoalError


def drawn(text: str, side_px: int = 64) -> np.ndarray:
    return -letter_relief(text, side_px)


def test_letters_are_sunk_into_a_plate() -> None:
    assert letter_relief("A", 64).min() == -1 and letter_relief("A", 64).max() == 0


def test_letters_stand_upright_and_read_from_left_to_right() -> None:
    a, e = (drawn(letter) for letter in "AE")
    assert a[:16].sum() < a[48:].sum()  # an A is narrow at the top, row 0
    assert e[:, :21].sum() > 1.2 * e[:, 43:].sum()  # an E's stem is on its left
    assert drawn("L")[-8:].sum() > drawn("L")[:8].sum()


def test_the_hole_of_an_o_is_not_sunk() -> None:
    ring = drawn("O", 65)
    assert ring[32, 32] == 0
    assert ring.max() == 1


def test_letters_are_as_large_as_fits() -> None:
    rows = np.flatnonzero(drawn("A").any(axis=1))
    columns = np.flatnonzero(drawn("AB").any(axis=0))
    assert rows[-1] - rows[0] + 1 >= 60
    assert columns[-1] - columns[0] + 1 >= 62


@pytest.mark.parametrize(
    ("text", "family", "sentence"), [(" ", "DejaVu Serif", "no letter"), ("A", "Nowhere", "no font")]
)
def test_what_cannot_be_drawn_is_a_sentence(text: str, family: str, sentence: str) -> None:
    with pytest.raises(GoalError, match=sentence):
        letter_relief(text, 32, family=family)


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_are_symmetric(name: str) -> None:
    shape = shape_relief(name, 40)
    np.testing.assert_allclose(shape, shape[::-1], atol=1e-12)
    np.testing.assert_allclose(shape, shape[:, ::-1], atol=1e-12)
    assert shape.min() >= 0 and shape.max() <= 1


def test_shapes_are_what_they_are_called() -> None:
    x = (np.arange(40) + 0.5) / 20 - 1
    np.testing.assert_allclose(shape_relief("pyramid", 40)[20], 1 - np.abs(x).clip(1 / 40), atol=1e-12)
    np.testing.assert_allclose(shape_relief("dome", 40)[20], np.sqrt(1 - x**2 - (1 / 40) ** 2), atol=1e-12)
    assert shape_relief("cross", 40)[20, 20] == 0 and shape_relief("cross", 40)[20, 2] == 1
    assert np.ptp(shape_relief("flat", 40)) == 0
    with pytest.raises(GoalError, match="no shape 'sphere'; known are pyramid"):
        shape_relief("sphere", 40)

"""Reliefs of letters and shapes, and their placement."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pentimento.goals3d import fonts
from pentimento.goals3d.fonts import font_for, installed_fonts
from pentimento.goals3d.reliefs import SHAPES, letter_relief, place, shape_relief, soften
from pentimento.planning.pushes.goal import GoalError

SERIF = next(installed_fonts())


def drawn(text: str, side_px: int = 64) -> np.ndarray:
    return -letter_relief(text, side_px)


def test_letters_are_sunk_into_plate() -> None:
    assert letter_relief("A", 64).min() == -1 and letter_relief("A", 64).max() == 0


def test_letters_are_upright_and_left_to_right() -> None:
    a, e = (drawn(letter) for letter in "AE")
    assert a[:16].sum() < a[48:].sum()  # an A is narrow at the top, row 0
    assert e[:, :21].sum() > 1.2 * e[:, 43:].sum()  # an E's stem is on its left
    assert drawn("L")[-8:].sum() > drawn("L")[:8].sum()


def test_letter_holes_are_not_sunk() -> None:
    ring = drawn("O", 65)
    assert ring[32, 32] == 0
    assert ring.max() == 1


def test_letters_fill_the_square() -> None:
    rows = np.flatnonzero(drawn("A").any(axis=1))
    columns = np.flatnonzero(drawn("AB").any(axis=0))
    assert rows[-1] - rows[0] + 1 >= 60
    assert columns[-1] - columns[0] + 1 >= 62


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("山", "CJK UNIFIED IDEOGRAPH-5C71"),
        ("A山", "CJK"),
        ("ب", "ARABIC LETTER BEH"),
        ("क", "DEVANAGARI LETTER KA"),
        ("ก", "THAI CHARACTER KO KAI"),
        ("א", "HEBREW LETTER ALEF"),
        ("😀", "GRINNING FACE"),
        ("A\n", "U\\+000A"),
        ("A\u200b", "ZERO WIDTH SPACE"),
        ("\ue000", "U\\+E000"),
    ],
)
def test_a_character_that_the_font_lacks_is_refused_by_name(text: str, name: str) -> None:
    with pytest.raises(GoalError, match=name):
        letter_relief(text, 32, SERIF)


def test_an_installed_font_that_has_the_letters_is_found_by_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A computer with two fonts, of which the first lacks what the other has."""
    both = [SERIF, SERIF.with_name("DejaVuSans.ttf")]
    monkeypatch.setattr(fonts, "installed_fonts", lambda: iter(both))
    assert font_for("Ж") == both[0]
    assert font_for("\u0628") == both[1]  # Arabic, in which the serif has nothing
    assert letter_relief("\u0628", 32).min() == -1
    with pytest.raises(GoalError, match=r"No font on this computer has all characters of '山'.*CJK.*--font"):
        font_for("山")
    monkeypatch.setattr(fonts, "installed_fonts", lambda: iter([]))
    with pytest.raises(GoalError, match="No font is installed"):
        font_for("A")
    (tmp_path / "broken.ttf").write_bytes(b"no font")
    with pytest.raises(GoalError, match="cannot be read as a font"):
        font_for("A", tmp_path / "broken.ttf")


@pytest.mark.parametrize("text", ["", " ", "  ", "\u00a0", "\u2003"])
def test_text_without_a_mark_is_refused(text: str) -> None:
    with pytest.raises(GoalError, match="no letter to sculpt"):
        letter_relief(text, 32)


def test_letters_of_other_scripts_accents_and_dollars_are_drawn() -> None:
    for text in ("Ж", "Ω", "é", "$"):
        assert drawn(text).max() == 1
    np.testing.assert_array_equal(drawn("e\u0301"), drawn("é"))
    assert not np.array_equal(drawn("$A$"), drawn("A"))  # no formula


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_are_symmetric(name: str) -> None:
    shape = shape_relief(name, 40)
    np.testing.assert_allclose(shape, shape[::-1], atol=1e-12)
    np.testing.assert_allclose(shape, shape[:, ::-1], atol=1e-12)
    assert shape.min() >= 0 and shape.max() <= 1


def test_shapes_match_closed_forms() -> None:
    x = (np.arange(40) + 0.5) / 20 - 1
    np.testing.assert_allclose(shape_relief("pyramid", 40)[20], 1 - np.abs(x).clip(1 / 40), atol=1e-12)
    np.testing.assert_allclose(shape_relief("dome", 40)[20], np.sqrt(1 - x**2 - (1 / 40) ** 2), atol=1e-12)
    assert shape_relief("cross", 40)[20, 20] == 0 and shape_relief("cross", 40)[20, 2] == 1
    assert np.ptp(shape_relief("flat", 40)) == 0
    with pytest.raises(GoalError, match="no shape 'sphere'; known are pyramid"):
        shape_relief("sphere", 40)


def test_place_centres_relief_and_keeps_proportions() -> None:
    bar = np.zeros((10, 40))
    bar[1:-1, 1:-1] = 1.0
    placed = place(bar, (64, 64), 0.625)
    rows, columns = np.nonzero(placed > 0.5)
    assert (rows.min() + rows.max()) / 2 == pytest.approx(31.5, abs=0.5)
    assert (columns.min() + columns.max()) / 2 == pytest.approx(31.5, abs=0.5)
    assert np.ptp(columns) / np.ptp(rows) == pytest.approx(37 / 7, rel=0.02)


def test_place_extends_rim() -> None:
    plate = np.full((8, 8), 5.0)
    plate[3:5, 3:5] = 0.0
    assert set(np.unique(place(plate, (32, 32), 0.5)[:7])) == {5.0}


@pytest.mark.parametrize("share", [0.0, 1.5, float("nan")])
def test_place_rejects_invalid_share(share: float) -> None:
    with pytest.raises(GoalError, match="of the area"):
        place(np.zeros((4, 4)), (8, 8), share)


def test_place_rejects_holes_and_lines() -> None:
    with pytest.raises(GoalError, match="1 holes"):
        place(np.array([[0.0, np.nan], [0, 0]]), (8, 8), 1.0)
    with pytest.raises(GoalError, match="at least 2 x 2"):
        place(np.zeros((1, 5)), (8, 8), 1.0)


def test_soften_conserves_volume_and_lowers_slopes() -> None:
    step = np.zeros((40, 40))
    step[10:30, 10:30] = 1.0
    soft = soften(step, 2.0)
    assert soft.sum() == pytest.approx(step.sum(), rel=1e-6)
    assert np.abs(np.diff(soft)).max() < 0.3
    np.testing.assert_array_equal(soften(step, 0.0), step)

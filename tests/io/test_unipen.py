"""Tests of the import of UNIPEN."""

from pathlib import Path

import numpy as np
import pytest

from pentimento.cli.main import main
from pentimento.contracts.errors import ContractError
from pentimento.io.unipen import read_unipen
from tests.io.pens import STROKES_MM, assert_places, demonstrations, saved, unipen

PER_MM = ".X_POINTS_PER_MM 100\n.Y_POINTS_PER_MM 100"


@pytest.mark.parametrize(
    ("head", "per_mm", "options"),
    [
        (PER_MM, (100.0, 100.0), ()),
        (".X_POINTS_PER_INCH 2540\n.Y_POINTS_PER_INCH 1270", (100.0, 50.0), ()),
        (".X_POINTS_PER_INCH 2540", (100.0, 100.0), ()),
        ("", (100.0, 100.0), ("--units", "0.01 mm")),
    ],
)
def test_places_are_read_in_their_unit(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    head: str,
    per_mm: tuple[float, float],
    options: tuple[str, ...],
) -> None:
    path = unipen(tmp_path, [stroke * per_mm for stroke in STROKES_MM], "X Y", head)
    assert_places(demonstrations(path, *options), STROKES_MM)
    assert "y points up, as UNIPEN's own tools draw it; else give --y-down." in capsys.readouterr().out
    mirrored = [stroke * [1, -1] for stroke in STROKES_MM]
    assert_places(demonstrations(path, "--y-down", *options), mirrored)


def test_times_are_in_milliseconds_or_by_the_rate(tmp_path: Path) -> None:
    steps = [np.arange(len(stroke))[:, None] for stroke in STROKES_MM]
    timed = [np.hstack([stroke * 100, 7 + 20 * t, 5 + t]) for stroke, t in zip(STROKES_MM, steps, strict=True)]
    for found in (
        demonstrations(unipen(tmp_path, timed, "X Y T P", PER_MM)),
        demonstrations(unipen(tmp_path, [s * 100 for s in STROKES_MM], "X Y", f"{PER_MM}\n.POINTS_PER_SECOND 50")),
    ):
        for points, t in zip(found, steps, strict=True):
            np.testing.assert_allclose(points[:, 0], 0.02 * t[:, 0], atol=1e-6)
    pressed = demonstrations(unipen(tmp_path, timed, "X Y T P", PER_MM))
    np.testing.assert_allclose(pressed[1][:, 4], [5 / 8, 6 / 8, 7 / 8], atol=1e-6)


def test_points_of_a_lifted_pen_take_time_and_draw_nothing(tmp_path: Path) -> None:
    head = ".COORD X Y\n.X_POINTS_PER_MM 10\n.POINTS_PER_SECOND 100"
    path = saved(tmp_path / "a.upn", f"{head}\n.PEN_DOWN\n0 0\n10 0\n.PEN_UP\n20 0\n30 0\n.PEN_DOWN\n40 0\n50 0\n")
    first, second = read_unipen(path, None).strokes
    np.testing.assert_allclose(1e3 * first.points[:, 1], [0, 1])
    np.testing.assert_allclose(1e3 * second.points[:, 1], [4, 5])
    np.testing.assert_allclose(second.points[:, 0], [0.04, 0.05])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "has no points after a .PEN_DOWN"),
        (".COORD X T\n", r"line 1: .COORD names no X and Y"),
        (".PEN_DOWN\n1 2\n", "line 2: points come before .COORD"),
        (".COORD X Y\n.PEN_DOWN\n1 2\n3 four\n", "line 4: '3 four' is no point of numbers"),
        (".COORD X Y\n.PEN_DOWN\n1 2 3\n", "line 3: 3 numbers are no points of the values X Y"),
        (".COORD X Y\n.X_POINTS_PER_MM none\n", "line 2: .X_POINTS_PER_MM needs a number above 0"),
        (".POINTS_PER_SECOND 0\n", "line 1: .POINTS_PER_SECOND needs a number above 0"),
        (".INCLUDE other.dat\n", "line 1: another file is included"),
    ],
)
def test_a_malformed_file_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, said: str
) -> None:
    path = saved(tmp_path / "bad.unipen", text)
    with pytest.raises(ContractError, match=said) as caught:
        read_unipen(path, 1e-3)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    assert main(["import", str(path), "--hand", "ann", "--units", "mm", "--out", str(tmp_path / "out")]) == 1
    assert "Traceback" not in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("between", "said"),
    [
        (".COMMENT a remark", "a point follows a keyword that is no .PEN_DOWN"),
        (".PEN_UP\n.X_POINTS_PER_MM 10\n.PEN_DOWN", "the unit of length changes"),
    ],
)
def test_points_are_neither_lost_nor_read_in_another_unit(tmp_path: Path, between: str, said: str) -> None:
    """Two recordings one behind the other, and a remark within a stroke."""
    path = saved(tmp_path / "a.unipen", f".COORD X Y\n{PER_MM}\n.PEN_DOWN\n100 200\n300 400\n{between}\n500 600\n")
    with pytest.raises(ContractError, match=said):
        read_unipen(path, None)

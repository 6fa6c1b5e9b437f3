"""Tests of the import of paths and pictures as arrays."""

from pathlib import Path

import numpy as np
import pytest

from pentimento.cli.main import main
from pentimento.contracts.images import decode_png
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.io.pair_arrays import read_pairs
from tests.io.test_photo_pairs import ink_centre_m

PX_PER_MM = 4
WINDOW_MM = (-15.0, -20.0, 45.0, 20.0)
OPTIONS = ("--units", "mm", "--press", "2 mm", "--window", "-15 mm, -20 mm, 45 mm, 20 mm", "--tool", "quill")
STARTS_MM = np.array([[0.0, 0.0], [3.0, 5.0], [-2.0, -4.0]])


def lines(start_mm: np.ndarray) -> np.ndarray:
    """Straight strokes of 20 mm, up to the right: x, y in mm and the share of the press [3, 9, 3]."""
    t = np.linspace(0, 1, 9)
    path = start_mm[:, None] + np.stack([20 * t, 8 * t], axis=-1)
    return np.concatenate([path, np.broadcast_to(0.5 + 0.5 * t, (3, 9))[..., None]], axis=-1)


def pictures(paths: np.ndarray) -> dict[str, np.ndarray]:
    """White before, and after with a disc of 2 mm around each point, in grey."""
    columns, rows = ((WINDOW_MM[2] - WINDOW_MM[0]) * PX_PER_MM, (WINDOW_MM[3] - WINDOW_MM[1]) * PX_PER_MM)
    x = WINDOW_MM[0] + (np.arange(int(columns)) + 0.5) / PX_PER_MM
    y = WINDOW_MM[3] - (np.arange(int(rows)) + 0.5) / PX_PER_MM
    near = [np.min([np.hypot(x - px, (y - py)[:, None]) for px, py in path[:, :2]], axis=0) < 2 for path in paths]
    return {"before": np.full((len(paths), *near[0].shape), 255, np.uint8), "after": np.where(near, 40, 255)}


def saved(folder: Path, **arrays: np.ndarray) -> Path:
    made = {name: array.astype(np.uint8) if name in ("before", "after") else array for name, array in arrays.items()}
    np.savez(folder / "pairs.npz", **made)
    return folder / "pairs.npz"


@pytest.mark.parametrize(("starts_mm", "frame"), [(STARTS_MM, "canvas"), (0 * STARTS_MM, "stroke")])
def test_ink_lies_on_the_path(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], starts_mm: np.ndarray, frame: str
) -> None:
    paths = lines(starts_mm)
    file = saved(tmp_path, path=paths, **pictures(paths), order=np.array([7, 3, 5]), scale=np.float32(4))
    assert main(["import", str(file), *OPTIONS, "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "no such columns: scale." in said and "y points up; else give --y-down." in said
    assert ("each stroke's own frame" in said) == (frame == "stroke")
    rows = read_table(tmp_path / "out", CONTRACT).table.to_pylist()
    assert [row["order"] for row in rows] == [7, 3, 5] and (tmp_path / "out/contact_sheet.png").is_file()
    for row, made in zip(rows, paths, strict=True):
        path = np.array(row["path"])
        assert row["frame"] == frame and np.isnan(path[:, 0]).all() and not path[:, 4].any()
        np.testing.assert_allclose(path[:, 1:3], 1e-3 * made[:, :2], atol=1e-7)
        np.testing.assert_allclose(path[:, 3], -2e-3 * made[:, 2], atol=1e-7)
        np.testing.assert_allclose(ink_centre_m(row), path[:, 1:3].mean(0), atol=2e-4)
        assert decode_png(row["before"]["bytes"]).min() == 255


def test_downward_axes_give_the_mirrored_stroke_on_its_ink(tmp_path: Path) -> None:
    paths = lines(STARTS_MM)
    file = saved(tmp_path, path=paths * [1, -1, 1], **pictures(paths))
    assert main(["import", str(file), *OPTIONS, "--y-down", "--out", str(tmp_path / "out")]) == 0
    for row in read_table(tmp_path / "out", CONTRACT).table.to_pylist():
        np.testing.assert_allclose(ink_centre_m(row), np.array(row["path"])[:, 1:3].mean(0), atol=2e-4)


def test_full_paths_keep_times_heights_and_yaw(tmp_path: Path) -> None:
    paths = lines(STARTS_MM)
    t = np.broadcast_to(np.linspace(0, 1.6, 9), (3, 9))
    full = np.stack([t, paths[..., 0], paths[..., 1], -paths[..., 2], 0.1 + 0 * t], axis=-1)
    pairs = read_pairs(saved(tmp_path, path=full, **pictures(paths)), 1e-3, None)
    for stroke, made in zip(pairs.strokes, full, strict=True):
        np.testing.assert_allclose(stroke.path, made * [1, 1e-3, 1e-3, 1e-3, 1], atol=1e-12)


@pytest.mark.parametrize(
    ("changed", "options", "said"),
    [
        ({"before": None}, OPTIONS, "has no array 'before' among after, path"),
        ({"path": np.zeros((3, 9, 4))}, OPTIONS, r"write numbers [strokes, points, 3]"),
        ({"path": np.zeros((2, 9, 3))}, OPTIONS, "has 2 paths, 3 pictures before and 3 after"),
        ({"after": np.zeros((3, 8, 9, 2))}, OPTIONS, "after is uint8 [3, 8, 9, 2]"),
        ({"path": 3 * lines(STARTS_MM)}, OPTIONS, "--press is the depth where z is 1"),
        ({}, (*OPTIONS[:2], *OPTIONS[4:]), "z is never below 0, so nothing presses"),
        ({}, OPTIONS[2:], "needs --units"),
        ({"path": lines(0 * STARTS_MM)}, (*OPTIONS, "--y-down"), "every path begins at 0, 0"),
    ],
)
def test_what_does_not_fit_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changed: dict, options: tuple[str, ...], said: str
) -> None:
    paths = lines(STARTS_MM)
    arrays = {"path": paths, **pictures(paths)} | changed
    file = saved(tmp_path, **{name: array for name, array in arrays.items() if array is not None})
    assert main(["import", str(file), *options, "--out", str(tmp_path / "out")]) == 1
    (sentence,) = capsys.readouterr().err.splitlines()
    assert said in sentence and not (tmp_path / "out").exists()


def test_what_is_no_npz_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "pairs.npz"
    np.save(tmp_path / "one.npy", np.zeros(3))
    for content in (b"", b"PK\x03\x04 broken", b"no zip", (tmp_path / "one.npy").read_bytes()):
        file.write_bytes(content)
        assert main(["import", str(file), *OPTIONS, "--out", str(tmp_path / "out")]) == 1
        assert "cannot be read as .npz" in capsys.readouterr().err
    np.savez(file, path=np.array([{}], dtype=object))
    assert main(["import", str(file), *OPTIONS, "--out", str(tmp_path / "out")]) == 1
    assert "cannot be read as .npz" in capsys.readouterr().err

"""Scans: from depth pictures and height maps in files to the height map of a slab."""

import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.height_maps import encode_height_png
from pentimento.robots.rig import rotation_of
from pentimento.robots.scan_files import FolderScanner, RecordedScanner, ScanFiles, connect
from pentimento.robots.scanner import DepthCamera, Pose, ScannerError, depth_points, scan_of_points
from tests.robots.machines import make_rig

AREA_M, SHAPE = (0.24, 0.2), (40, 48)
DOWN = Pose((0.12, 0.1, 0.5), (np.pi, 0.0, 0.0))
CAMERA = DepthCamera((400.0, 410.0), (119.5, 99.5), DOWN)


def plane(x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    return 0.03 + 0.1 * x_m - 0.05 * y_m


def depth_of_plane(camera: DepthCamera, shape: tuple[int, int] = (200, 240)) -> np.ndarray:
    """Closed form: the depth at which each pixel's ray meets z = .03 + .1 x − .05 y."""
    rows, columns = np.indices(shape)
    x, y = (columns - camera.centre_px[0]) / camera.focal_px[0], (rows - camera.centre_px[1]) / camera.focal_px[1]
    rays = np.stack([x, y, np.ones(shape)], axis=-1) @ rotation_of(*camera.to_canvas.turn_rad).T
    origin, normal = np.array(camera.to_canvas.origin_m), np.array([-0.1, 0.05, 1.0])
    return (0.03 - origin @ normal) / (rays @ normal)


@pytest.mark.parametrize("turn", [(np.pi, 0.0, 0.0), (np.pi, 0.0, np.pi / 2), (np.pi - 0.15, 0.1, 0.4)])
def test_depth_picture_of_a_plane_is_that_plane(turn: tuple[float, float, float]) -> None:
    camera = replace(CAMERA, focal_px=(300.0, 310.0), to_canvas=Pose((0.12, 0.06, 0.5), turn))
    scan = scan_of_points(depth_points(depth_of_plane(camera), camera), AREA_M, SHAPE, "here")
    rows, columns = np.indices(SHAPE)
    expected = plane((columns + 0.5) * 0.005, AREA_M[1] - (rows + 0.5) * 0.005)
    seen = ~np.isnan(scan.height_m)
    assert seen.mean() > 0.6
    assert np.abs(scan.height_m - expected)[seen].max() < 0.15 * 0.0025 + 1e-9  # half a pixel's slope
    assert scan.window_m.tolist() == [0, 0, *AREA_M] and np.isnan(scan.table_plane).all()


def files(folder: Path, **changes: Any) -> ScanFiles:
    return replace(ScanFiles("folder", str(folder), 5.0, "heights", unit_m=1e-6), **changes)


def heights() -> np.ndarray:
    rows, columns = np.indices(SHAPE)
    values = 0.03 + 1e-4 * rows + 1e-5 * columns
    values[:6, 30:] = np.nan
    return values


def replayed(folder: Path, **changes: Any) -> np.ndarray:
    return RecordedScanner(files(folder, **changes), AREA_M, SHAPE).scan().height_m


def test_height_files_keep_their_pixels_their_top_and_their_holes(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", heights())
    np.testing.assert_allclose(replayed(tmp_path), heights(), atol=1e-12)
    (tmp_path / "a.npy").unlink()
    (tmp_path / "b.png").write_bytes(encode_height_png(heights(), 1e-6))
    np.testing.assert_allclose(replayed(tmp_path), heights(), atol=1e-6)


def test_finer_heights_are_averaged_and_a_window_places_them(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.repeat(np.repeat(heights(), 3, 0), 3, 1))
    np.testing.assert_allclose(replayed(tmp_path), heights(), atol=1e-12)
    np.save(tmp_path / "a.npy", heights()[:, 5:])
    right = replayed(tmp_path, window_m=(0.025, 0.0, 0.24, 0.2))
    np.testing.assert_allclose(right[:, 5:], heights()[:, 5:], atol=1e-12)
    assert np.isnan(right[:, :5]).all()


def test_depth_files_of_both_kinds_agree(tmp_path: Path) -> None:
    depth = depth_of_plane(CAMERA)
    depth[50:60, 70:90] = 0.0
    of_depth = {"holds": "depth", "focal_px": CAMERA.focal_px, "centre_px": CAMERA.centre_px, "camera_to_canvas": DOWN}
    np.save(tmp_path / "a.npy", depth.astype(np.float32))
    exact = replayed(tmp_path, **of_depth)
    (tmp_path / "a.npy").unlink()
    cv2.imwrite(str(tmp_path / "a.png"), np.rint(depth / 1e-4).astype(np.uint16))
    np.testing.assert_allclose(replayed(tmp_path, unit_m=1e-4, **of_depth), exact, atol=6e-5)
    assert 0 < np.isnan(exact).sum() < 60


def write(path: Path, name: str) -> None:
    """A file that is no scan, by its name."""
    png = encode_height_png(heights(), 1e-6)
    match name:
        case "truncated.png":
            path.write_bytes(png[: len(png) // 2])
        case "empty.png":
            path.write_bytes(b"")
        case "8 bits.png":
            cv2.imwrite(str(path), np.full(SHAPE, 9, np.uint8))
        case "colour.png":
            cv2.imwrite(str(path), np.full((*SHAPE, 3), 9, np.uint16))
        case "holes.png":
            cv2.imwrite(str(path), np.zeros(SHAPE, np.uint16))
        case "text.npy":
            path.write_text("0.03 0.03", encoding="utf-8")
        case "pickled.npy":
            np.save(path, np.array([{}]), allow_pickle=True)
        case "cut.npy":
            np.save(path, heights())
            path.write_bytes(path.read_bytes()[:-100])
        case "whole numbers.npy":
            np.save(path, np.full(SHAPE, 30))
        case "stack.npy":
            np.save(path, heights()[None])
        case "nan.npy":
            np.save(path, np.full(SHAPE, np.nan))
        case "infinite.npy":
            np.save(path, np.where(np.isnan(heights()), np.inf, heights()))
        case "millimetres.npy":
            np.save(path, 1000 * heights())
        case "corner.npy":
            np.save(path, np.where(np.indices(SHAPE)[0] < 15, heights(), np.nan))
        case _:
            raise AssertionError(name)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("truncated.png", "cannot be read as a scan"),
        ("empty.png", "cannot be read as a scan"),
        ("8 bits.png", "16 bits a pixel, and this PNG has 8"),
        ("colour.png", "8-bit grey or 16-bit grey"),
        ("holes.png", "nothing but holes"),
        ("text.npy", "cannot be read as a scan"),
        ("pickled.npy", "cannot be read as a scan"),
        ("cut.npy", "cannot be read as a scan"),
        ("whole numbers.npy", r"holds int64\[40, 48\]; a scan is float"),
        ("stack.npy", r"holds float64\[1, 40, 48\]"),
        ("nan.npy", "nothing but holes; see that the scanner is not covered"),
        ("infinite.npy", "a height of inf m"),
        ("millimetres.npy", "Save metres, not millimetres"),
        ("corner.npy", "shows 32 % of the 48 x 40 pixels of the slab"),
    ],
)
def test_what_is_no_scan_is_refused_in_one_sentence_with_its_name(tmp_path: Path, name: str, words: str) -> None:
    write(tmp_path / name, name)
    with pytest.raises(ScannerError, match=words) as refused:
        replayed(tmp_path)
    assert name in str(refused.value) and "\n" not in str(refused.value)


def test_depths_that_do_not_fit_the_camera_are_refused(tmp_path: Path) -> None:
    of_depth = {"holds": "depth", "focal_px": (400.0, 400.0), "centre_px": (320.0, 240.0), "camera_to_canvas": DOWN}
    np.save(tmp_path / "a.npy", depth_of_plane(CAMERA))
    with pytest.raises(ScannerError, match=r"240 x 200 pixels and the centre .* lies outside"):
        replayed(tmp_path, **of_depth)
    np.save(tmp_path / "a.npy", -depth_of_plane(CAMERA))
    with pytest.raises(ScannerError, match="holds a depth of -0"):
        replayed(tmp_path, **of_depth)


def test_recorded_files_come_in_the_order_of_their_names_and_end(tmp_path: Path) -> None:
    for number in (2, 10, 1):
        np.save(tmp_path / f"scan_{number:03}.npy", np.full(SHAPE, 0.01 * number))
    (tmp_path / "notes.txt").write_text("not a scan", encoding="utf-8")
    scanner = RecordedScanner(files(tmp_path), AREA_M, SHAPE)
    assert [round(float(scanner.scan().height_m[0, 0]), 6) for _ in range(3)] == [0.01, 0.02, 0.1]
    with pytest.raises(ScannerError, match="holds 3 scans, and all of them were given"):
        scanner.scan()


def test_folder_takes_a_new_and_complete_file_only(tmp_path: Path) -> None:
    np.save(tmp_path / "z_old.npy", np.full(SHAPE, 0.05))
    np.save(tmp_path / "source", heights())
    whole = (tmp_path / "source.npy").read_bytes()
    (tmp_path / "source.npy").unlink()
    scanner = FolderScanner(files(tmp_path), AREA_M, SHAPE)

    def save() -> None:
        time.sleep(0.15)
        with (tmp_path / "new.npy").open("wb") as file:
            for part in range(0, len(whole), len(whole) // 4):
                file.write(whole[part : part + len(whole) // 4])
                file.flush()
                time.sleep(0.03)

    camera = threading.Thread(target=save)
    camera.start()
    np.testing.assert_allclose(scanner.scan().height_m, heights(), atol=1e-12)
    camera.join()
    with pytest.raises(ScannerError, match=r"No new scan came into .* within 0\.05 s"):
        FolderScanner(files(tmp_path, wait_s=0.05), AREA_M, SHAPE).scan()


TABLE = {"driver": "folder", "wait": "20 s", "holds": "depth", "unit": "0.1 mm"}
VIEW = {
    "focal_px": [610, 610.5],
    "centre_px": [320.0, 240.0],
    "camera_to_canvas": {"origin": ["150 mm", "100 mm", "0.6 m"], "turn": ["180 deg", "0 deg", "0 deg"]},
}


def test_rig_file_s_table_makes_the_scanner(tmp_path: Path) -> None:
    scanner = connect(make_rig(scanner=TABLE | VIEW | {"folder": str(tmp_path)}), SHAPE)
    assert scanner._files.camera is not None
    assert scanner._files.camera.to_canvas.turn_rad == pytest.approx((np.pi, 0, 0))
    assert (scanner._files.unit_m, scanner._files.wait_s) == pytest.approx((1e-4, 20.0))


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (TABLE | {"folder": "."}, "need focal_px, centre_px"),
        (TABLE | VIEW | {"folder": "nowhere"}, "names the folder nowhere, which is not there"),
        (TABLE | VIEW | {"folder": ".", "focal": 3}, r"\[scanner\] of rig bench: unknown keys \['focal'\]"),
        (TABLE | VIEW | {"folder": ".", "wait": "0 s"}, "above zero"),
        (TABLE | VIEW | {"folder": ".", "wait": 20}, "wait"),
        (TABLE | VIEW | {"folder": ".", "focal_px": [0.0, 600.0]}, "both are above zero"),
    ],
)
def test_bad_tables_are_refused(table: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        connect(make_rig(scanner=table), SHAPE)

"""How well photographs of recording sheets are read: `python -m studies.phone_recording`.

For each seed a sheet is printed, painted along its guide lines with strokes of known place and colour, and photographed
before and after by a drawn phone: perspective, rotation, uneven light and a shadow, white balance, a tone curve, lens
distortion, blur, noise and JPEG. The reader sees the files alone.

A table goes to the screen. Exit status 1 where a photograph misses a bar.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import calibrate_camera
from pentimento.collection.recording_sheet import (
    CANVAS_M,
    COMMANDS,
    PRINT_PX_PER_M,
    paper_window,
    sheet_markers,
    sheet_name,
    write_recording,
)
from pentimento.collection.sheet_photo import PAPER
from pentimento.contracts.colour import delta_e_2000, linear_to_srgb, srgb_to_lab, srgb_to_linear, to_uint8
from pentimento.contracts.frames import canvas_to_pixel, pixel_to_canvas
from pentimento.contracts.images import decode_image, decode_png, read_image
from pentimento.contracts.observations import Photo
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.io.photo_pairs import read_paths
from pentimento.io.photographed_sheets import read_sheets
from pentimento.io.stroke_rows import RecordedPath
from pentimento.robots.tools import load_tool

FloatArray = NDArray[np.float64]
Picture = NDArray[np.uint8]

MAX_MISS_M: Final = 3e-4
MAX_DELTA_E: Final = 4.0
FRAME_PX: Final = (4000, 3000)  # 12 megapixels
_TABLE_SRGB: Final = (0.45, 0.36, 0.28)
_GRID: Final = 400  # pixels between points of the frame at which the lens is evaluated


@dataclass(frozen=True, eq=False)
class Phone:
    """One photograph's camera and light."""

    from_canvas: FloatArray
    """[3, 3] canvas metres to undistorted pixels."""
    distortion: float
    """Radial: shift at half the frame's diagonal, share of the distance."""
    gains: FloatArray
    """[3] on linear light: exposure and white balance."""
    light: FloatArray
    """[5] relative light over the frame: slopes along x and y, vignette, depth and place of a shadow's edge."""
    tone: float
    """Exponent on linear light."""
    blur_px: float
    jpeg: int
    size_px: tuple[int, int]


@dataclass(frozen=True)
class Measured:
    """What one recording came to."""

    seed: int
    register_m: float
    """Largest distance on the canvas, over the paths of both photographs, between the true and the found place."""
    ink_m: float
    """Largest distance, over the rows, between the middle of the true paint and that in the row's pictures."""
    delta_e: float
    """CIEDE2000 of the table's paint."""
    paper_delta_e: float
    """CIEDE2000 of the median of the paper."""
    rows: int
    painted: int

    @property
    def met(self) -> bool:
        """Whether it is within the bars."""
        return (
            max(self.register_m, self.ink_m) <= MAX_MISS_M and self.delta_e <= MAX_DELTA_E and self.rows == self.painted
        )


def draw_phone(seed: int, number: int, size_px: tuple[int, int] = FRAME_PX, distortion: float = 0.001) -> Phone:
    """A photograph's camera and light, by seed."""
    rng = np.random.default_rng([seed, number])
    width, height = size_px
    focal = 0.75 * width  # a phone's main camera
    tilt, turn = rng.uniform(-0.3, 0.3, size=2), rng.integers(4) * np.pi / 2 + rng.uniform(-0.25, 0.25)
    about_x, about_y = (cv2.Rodrigues(axis)[0] for axis in (np.array([tilt[0], 0, 0]), np.array([0, tilt[1], 0])))
    # The canvas's y points up and the frame's down.
    turned = about_y @ about_x @ cv2.Rodrigues(np.array([0, 0, turn]))[0] @ np.diag([1.0, -1.0, -1.0])
    low = paper_window(CANVAS_M)
    corners = np.array([[x, y, 0.0] for x in low[[0, 2]] for y in low[[1, 3]]]) - [CANVAS_M[0] / 2, CANVAS_M[1] / 2, 0]
    seen = corners @ turned.T
    distance = max(
        float((np.abs(seen[:, :2]) * focal / (np.array(size_px) * rng.uniform(0.42, 0.46)) - seen[:, 2:]).max()), 0.1
    )
    pinhole = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    placed = np.column_stack([turned[:, :2], turned @ [-CANVAS_M[0] / 2, -CANVAS_M[1] / 2, 0] + [0, 0, distance]])
    return Phone(
        from_canvas=pinhole @ placed,
        distortion=distortion * rng.uniform(-1, 1),
        gains=rng.uniform(0.6, 0.8) * rng.uniform(0.88, 1.12, size=3),
        light=np.array(
            [*rng.uniform(-0.2, 0.2, 2), rng.uniform(0.0, 0.25), rng.uniform(0, 0.2), rng.uniform(-0.4, 0.4)]
        ),
        tone=rng.uniform(0.94, 1.06),
        blur_px=rng.uniform(0.5, 1.3) * width / FRAME_PX[0],
        jpeg=int(rng.integers(80, 96)),
        size_px=size_px,
    )


def painted(printed: Picture, paths: Sequence[RecordedPath], color_srgb: FloatArray, seed: int) -> NDArray[np.float32]:
    """Linear light float32 [H, W, 3] of a printed sheet with opaque strokes along paths, wider where pressed."""
    linear = (PAPER * srgb_to_linear(np.arange(256) / 255)).astype(np.float32)[printed]
    linear[paint_mask(printed.shape, paths, seed)] = srgb_to_linear(color_srgb)
    return linear


def paint_mask(shape: tuple[int, ...], paths: Sequence[RecordedPath], seed: int) -> NDArray[np.bool_]:
    """Where paint lies on a printed sheet [H, W]; a hand misses the guide line by up to a millimetre."""
    mask, window = np.zeros(shape[:2], np.uint8), paper_window(CANVAS_M)
    for path in paths:
        rng = np.random.default_rng([seed, int(path.name)])
        line = canvas_to_pixel(path.path[:, 1:3] + rng.uniform(-1e-3, 1e-3, 2), window, PRINT_PX_PER_M)
        widths = np.clip(0.002 - 1.2 * path.path[:, 3], 0.002, 0.007) * PRINT_PX_PER_M
        for start, end, width in zip(line[:-1], line[1:], widths, strict=False):
            ends = [tuple(int(v) for v in np.round(point)) for point in (start, end)]
            cv2.line(mask, ends[0], ends[1], 1, max(1, round(width)))
    return mask > 0


def photograph(sheet: NDArray[np.float32], phone: Phone, rng: np.random.Generator) -> bytes:
    """The JPEG of a sheet, linear light [H, W, 3] at PRINT_PX_PER_M."""
    width, height = phone.size_px
    canvas_from_sheet = np.linalg.inv(_pixels_from_canvas())
    to_frame = phone.from_canvas @ canvas_from_sheet
    table = tuple(float(v) for v in srgb_to_linear(np.array(_TABLE_SRGB)))
    sampled = cv2.warpPerspective(sheet, to_frame, (width, height), flags=cv2.INTER_LINEAR, borderValue=table)
    if phone.distortion:
        columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
        x, y = columns - np.float32(width / 2), rows - np.float32(height / 2)
        factor = 1 + np.float32(phone.distortion) * (x**2 + y**2) / np.float32((width**2 + height**2) / 4)
        sampled = cv2.remap(
            sampled, x * factor + np.float32(width / 2), y * factor + np.float32(height / 2), cv2.INTER_LINEAR,
            borderValue=table,
        )  # fmt: skip
    x, y = np.meshgrid(np.linspace(-1, 1, width, dtype=np.float32), np.linspace(-1, 1, height, dtype=np.float32))
    along_x, along_y, vignette, shadow, edge = (np.float32(v) for v in phone.light)
    light = (1 + along_x * x + along_y * y) * (1 - vignette * (x**2 + y**2) / 2)
    light *= 1 - shadow / (1 + np.exp(-(x + 0.5 * y - edge) / np.float32(0.25)))
    linear = cv2.GaussianBlur(sampled, (0, 0), phone.blur_px) * light[..., None] * phone.gains.astype(np.float32)
    linear += (0.004 + 0.01 * np.sqrt(np.maximum(linear, 0))) * rng.standard_normal(linear.shape, dtype=np.float32)
    levels = to_uint8(linear_to_srgb((np.arange(65536) / 65535) ** phone.tone))
    srgb = levels[np.rint(65535 * np.clip(linear, 0, 1)).astype(np.uint16)]
    done, data = cv2.imencode(".jpg", srgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, phone.jpeg])
    assert done
    return bytes(data.tobytes())


def seen_at(phone: Phone, xy_m: FloatArray) -> FloatArray:
    """Pixels [N, 2] (column, row) of canvas points [N, 2] in the photograph, through the lens."""
    straight = _projected(phone.from_canvas, xy_m) - np.array(phone.size_px) / 2
    found = straight.copy()
    for _ in range(10):  # straight = found (1 + d r²), by fixed-point iteration
        found = straight / (
            1 + phone.distortion * (found**2).sum(1, keepdims=True) / (np.square(phone.size_px).sum() / 4)
        )
    return found + np.array(phone.size_px) / 2


def measure(
    seed: int, folder: Path, *, strokes: int, size_px: tuple[int, int] = FRAME_PX, distortion: float = 0.001
) -> Measured:
    """Print, paint, photograph and read a recording of a round brush in an empty folder."""
    tool, rng = load_tool("round_brush"), np.random.default_rng(seed)
    color = rng.uniform([0.03] * 3, [0.55, 0.45, 0.6])
    recording = write_recording(folder / "recording", tool, strokes, seed)
    paths = read_paths(folder / "recording" / COMMANDS)
    printed = [read_image(folder / "recording" / sheet_name(sheet)) for sheet in range(recording.sheets)]
    files: dict[str, list[Path]] = {"before": [], "after": []}
    register_m = 0.0
    for sheet, blank in enumerate(printed):
        own = _on_sheet(paths, sheet)
        for at, (when, drawn) in enumerate((("before", ()), ("after", own))):
            phone = draw_phone(seed, 2 * sheet + at, size_px, distortion)
            file = folder / f"{when}_{sheet}.jpg"
            photo = photograph(painted(blank, drawn, color, seed), phone, rng)
            file.write_bytes(photo)
            files[when].append(file)
            register_m = max(register_m, _register_m(photo, phone, own))
    read = read_sheets(folder / "recording", files["before"][::-1], files["after"], folder / "table")
    rows = read_table(folder / "table", CONTRACT).table.to_pylist()
    masks = [paint_mask(blank.shape, _on_sheet(paths, sheet), seed) for sheet, blank in enumerate(printed)]
    paper = np.concatenate([decode_png(row["before"]["bytes"]).reshape(-1, 3) for row in rows])
    return Measured(
        seed=seed,
        register_m=register_m,
        ink_m=max(_ink_miss_m(row, masks[int(row["surface_id"].removeprefix("sheet_"))], color) for row in rows),
        delta_e=_delta_e(read.color_srgb, color),
        paper_delta_e=_delta_e(np.median(paper, axis=0) / 255, linear_to_srgb(np.full(3, PAPER))),
        rows=len(rows),
        painted=strokes,
    )


def _on_sheet(paths: Sequence[RecordedPath], sheet: int) -> list[RecordedPath]:
    return [path for path in paths if path.about["surface_id"] == f"sheet_{sheet}"]


def _register_m(photo: bytes, phone: Phone, paths: Sequence[RecordedPath]) -> float:
    frame = decode_image(photo, "the photograph")
    found = calibrate_camera(Photo(frame, 0.0, 1.0, np.ones(3), 0.0), sheet_markers(CANVAS_M))
    xy_m = np.concatenate([path.path[:, 1:3] for path in paths])
    back = _projected(np.asarray(np.linalg.inv(found.camera_from_canvas), dtype=np.float64), seen_at(phone, xy_m))
    return float(np.linalg.norm(back - xy_m, axis=1).max())


def _ink_miss_m(row: Mapping[str, Any], mask: NDArray[np.bool_], color_srgb: FloatArray) -> float:
    """Distance between the middle of the true paint in a row's window and that of what changed in its pictures."""
    before, after = (decode_png(row[name]["bytes"]) / 255 for name in ("before", "after"))
    contrast = color_srgb - before
    share = np.clip(((after - before) * contrast).sum(-1) / (contrast**2).sum(-1), 0, 1)
    window = np.array(row["window_m"])
    found = _middle(share * (share > 0.25), window)
    low, high = (
        canvas_to_pixel(window[[0, 3]], paper_window(CANVAS_M), PRINT_PX_PER_M),
        canvas_to_pixel(window[[2, 1]], paper_window(CANVAS_M), PRINT_PX_PER_M),
    )
    (left, top), (right, bottom) = np.round(low + 0.5).astype(int), np.round(high + 0.5).astype(int)
    true = _middle(mask[top:bottom, left:right].astype(float), window)
    return float(np.linalg.norm(found - true))


def _middle(weight: FloatArray, window_m: FloatArray) -> FloatArray:
    rows, columns = np.nonzero(weight)
    scale = weight.shape[1] / (window_m[2] - window_m[0])
    xy = pixel_to_canvas(np.column_stack([columns, rows]), window_m, scale)
    return np.asarray(np.average(xy, axis=0, weights=weight[rows, columns]))


def _delta_e(one_srgb: FloatArray, other_srgb: FloatArray) -> float:
    return float(delta_e_2000(srgb_to_lab(np.asarray(one_srgb)), srgb_to_lab(np.asarray(other_srgb))))


def _pixels_from_canvas() -> FloatArray:
    """[3, 3] canvas metres to pixels of the printed sheet."""
    low = paper_window(CANVAS_M)
    k = float(PRINT_PX_PER_M)
    return np.array([[k, 0, -low[0] * k - 0.5], [0, -k, low[3] * k - 0.5], [0, 0, 1.0]])


def _projected(homography: FloatArray, xy: FloatArray) -> FloatArray:
    lifted = np.column_stack([xy, np.ones(len(xy))]) @ homography.T
    return np.asarray(lifted[:, :2] / lifted[:, 2:])


def main() -> int:
    """Command line; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.phone_recording", description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(10)), help="two photographs each")
    parser.add_argument("--strokes", type=int, default=15, help="15 fill a sheet")
    parser.add_argument("--distortion", type=float, default=0.001, help="of the lens, at half the diagonal, at most")
    args = parser.parse_args()
    print("| seed | rows | registration | paint's middle | ΔE paint | ΔE paper |\n|---|---|---|---|---|---|")
    met = True
    for seed in args.seeds:
        with tempfile.TemporaryDirectory() as folder:
            found = measure(seed, Path(folder), strokes=args.strokes, distortion=args.distortion)
        print(
            f"| {seed} | {found.rows} of {found.painted} | {1e3 * found.register_m:.3f} mm "
            f"| {1e3 * found.ink_m:.3f} mm | {found.delta_e:.1f} | {found.paper_delta_e:.1f} |",
            flush=True,
        )
        met &= found.met
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())

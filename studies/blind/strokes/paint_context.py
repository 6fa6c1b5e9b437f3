"""A studio for many short recordings: the camera reads out only a part of its frame, and single strokes can be
disturbed by effects that the studio does not have.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pentimento.contracts.observations import Photo
from pentimento.studio.shared import Item
from pentimento.studio.strokes.brush import Bundle
from pentimento.studio.strokes.camera import Optics, expose
from pentimento.studio.strokes.sheet import refresh
from pentimento.studio.strokes.studio import BLACK_SRGB, PHOTO_S, Studio
from pentimento.studio.strokes.world import World

Mode = Literal["width", "amplitude", "blur", "tangential", "normal", "canvas_x", "canvas_y"]

REALISATION = 1_000_000  # max number of items of one kind in a recording
PAD_PX = 6  # of the frame around the part that is read out, for the blur of the lens

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Disturbance:
    """An effect on one stroke: `amount` is metres for shifts, a relative change for the other modes."""

    mode: Mode
    amount: float


class PaintContext(Studio):
    """A `Studio` under one seed. Recordings of another `realisation` differ in their sheets, fills, friction,
    seats and camera noise (what differs between two repeats of an action), not in the tool.
    """

    def __init__(self, world: World, seed: int, realisation: int = 0) -> None:
        super().__init__(world, seed)
        if world.tool.kind == "flat":
            self._bundle = _balanced(replace(self._bundle, place=_rounded(self._bundle.place, world)))
        self._nominal = world, self._bundle, self._optics
        self._region: tuple[slice, slice] | None = None
        self._disturbance = Disturbance("width", 0.0)
        if realisation:
            for kind in (Item.SHEET, Item.DIP, Item.STROKE, Item.PHOTO):
                self._counts[kind] = realisation * REALISATION
            self._place_sheet()
            if world.tool.kind == "marker":
                self._fill(np.asarray(BLACK_SRGB), residue=0.0)

    def read_out(self, box_px: ArrayLike) -> None:
        """Photos hold only this box [4] (column and row of its corners) of the frame from now on; the rest is black."""
        left, top, right, bottom = np.asarray(box_px, dtype=np.float64)
        rows, columns = self._optics.column.shape
        row = slice(max(int(top) - PAD_PX, 0), min(int(bottom) + PAD_PX + 1, rows))
        self._region = row, slice(max(int(left) - PAD_PX, 0), min(int(right) + PAD_PX + 1, columns))

    def disturb(self, disturbance: Disturbance) -> None:
        """Disturb the strokes and photos from now on."""
        self._disturbance = disturbance
        world, self._bundle, self._optics = self._nominal
        self._world, by = world, 1 + disturbance.amount
        match disturbance.mode:
            case "width":
                tool = replace(
                    world.tool,
                    half_width_m=world.tool.half_width_m * by,
                    half_thickness_m=world.tool.half_thickness_m * by,
                )
                self._world = replace(world, tool=tool)
            case "amplitude":
                self._bundle = replace(self._bundle, wetting=self._bundle.wetting * by)
            case "blur":
                self._optics = replace(self._optics, blur_px=self._optics.blur_px * by)
            case _:
                pass  # shifts are of the path

    def stroke(self, path: FloatArray) -> FloatArray:
        """As `Studio.stroke`; a shift happens behind the encoders, which do not see it."""
        shift = np.zeros((len(path), 5))
        shift[:, 1:3] = _shift_m(np.asarray(path), self._disturbance)
        return super().stroke(path + shift) - shift

    def skip(self, drawn_m: float, seconds: float) -> None:
        """Advance tool wear and time as if strokes of this length had been painted."""
        self._worn_m += drawn_m
        self.clock_s += seconds

    def _look(self) -> None:
        """As `Studio._look`, only for the part that the camera reads out."""
        if self._region is None:
            super()._look()
            return
        optics, paint = self._optics, self._world.paint
        (top, left), (rows, columns) = self._corner, self._painted_s.shape
        row = _span(optics.row[self._region], top, rows)
        column = _span(optics.column[self._region], left, columns)
        part = row, column
        refresh(
            self._sheet_view()[part], self._seen_liquid[part], self._wet[part], self._below[part],
            self._painted_s[part], self.clock_s, paint.drying_s,
            paint.drying_loss * self._world.effects.drying_shift,
        )  # fmt: skip

    def photo(self) -> Photo:
        """As `Studio.photo`, of the part that is read out."""
        if self._region is None:
            return super().photo()
        self.clock_s += PHOTO_S
        self._look()
        camera, whole = self._world.camera, self._optics
        part = Optics(whole.column[self._region], whole.row[self._region], whole.light[self._region], whole.blur_px)
        frame = np.zeros((*whole.column.shape, 3), dtype=np.uint8)
        frame[self._region] = expose(self._scene, part, camera, self._next(Item.PHOTO))
        return Photo(frame, camera.exposure_s, camera.gain, np.asarray(camera.white_balance), self.clock_s)


def _rounded(place: FloatArray, world: World) -> FloatArray:
    """The places [B, 2] of a flat tool's bristles, blended from a disc (orientation 0) to a square (orientation 1).

    Otherwise the square bundle's width would still depend on the heading at `orientation_width` 0: the effect would be
    discontinuous there.
    """
    square = (np.abs(place) ** 5).sum(axis=1) ** 0.2
    disc = place * (square / np.maximum(np.linalg.norm(place, axis=1), 1e-9))[:, None]
    share = min(world.effects.orientation_width, 1.0)
    return share * place + (1 - share) * disc


def _balanced(bundle: Bundle) -> Bundle:
    """A bundle with fourfold symmetry: every fourth bristle and its three rotations by quarter turns.

    The bundle of a tool that keeps its arm's orientation does not turn with the stroke. Asymmetric pressure would shift
    all strokes by a constant, which is a `path_offset`, and an anisotropic bundle would have an `orientation_width` at
    strength 0.
    """
    place, short, wetting = bundle.place[::4], bundle.short_m[::4], bundle.wetting[::4]
    turned = [place]
    for _ in range(3):
        turned.append(turned[-1][:, ::-1] * (-1.0, 1.0))
    return Bundle(np.concatenate(turned), np.tile(short, 4), np.tile(wetting, 4))


def _span(scene: NDArray[np.float32], first: int, count: int) -> slice:
    """The sheet's cells (of `count`, which begin at the scene's cell `first`) that lie under places of the scene."""
    low, high = int(np.floor(scene.min())) - first, int(np.ceil(scene.max())) + 2 - first
    return slice(min(max(low, 0), count), min(max(high, 0), count))


def _shift_m(path: FloatArray, disturbance: Disturbance) -> FloatArray:
    """[N, 2] or [2]: where the path is moved."""
    amount = disturbance.amount
    match disturbance.mode:
        case "canvas_x":
            return np.array([amount, 0.0])
        case "canvas_y":
            return np.array([0.0, amount])
        case "tangential" | "normal":
            step = np.gradient(path[:, 1:3], axis=0)
            along = step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12)
            across = np.column_stack([-along[:, 1], along[:, 0]])
            return amount * (along if disturbance.mode == "tangential" else across)
        case _:
            return np.zeros(2)

"""The studio: the state of a sheet, a tool and a camera, changed by commands."""

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pentimento.contracts.colour import srgb_to_linear
from pentimento.contracts.errors import ContractError
from pentimento.contracts.markers import markers_around
from pentimento.contracts.observations import Photo
from pentimento.studio.shared import Gears, Item, item_rng
from pentimento.studio.strokes.brush import DAB_STEPS, Drag, bearing_n, drag, make_bundle
from pentimento.studio.strokes.camera import expose, make_optics, table_scene
from pentimento.studio.strokes.motion import Tip, execute
from pentimento.studio.strokes.sheet import (
    BLEED_M,
    CELLS_PER_M,
    WICKING_M_PER_SQRT_S,
    absorbency_field,
    grain_field,
    lay_film,
    pigment,
    refresh,
    sheet_shape,
    spread,
    surface_height_m,
)
from pentimento.studio.strokes.sweep import sweep
from pentimento.studio.strokes.world import World

PHOTO_S = 1.0  # what each takes
DIP_S = 5.0
WIPE_S = 4.0
SHEET_S = 20.0
RINSED = 0.015  # share of the old paint left in the bristles after a wipe, at full mixing strength
MIN_SPEED_M_S = 0.008  # bounds the wicking of a tool that hardly moves
NO_DEPLETION = 1e-30  # strength that makes the load so large that no stroke changes its floating-point number
BLACK_SRGB = (0.2, 0.195, 0.205)


class Studio:
    """A virtual world under one seed: the same commands give the same bytes.

    A marker begins with fresh black ink, a brush clean and dry. `dip` loads it, and
    replaces a marker by a fresh pen of that colour.
    """

    def __init__(self, world: World, seed: int) -> None:
        self._world, self._seed = world, seed
        self._bundle = make_bundle(world.tool, item_rng(seed, Item.TOOL, 0))
        self._layout = markers_around(world.paper.size_m)
        self._scene, self._corner = table_scene(
            world.paper.size_m, self._layout, world.camera.margin_m, item_rng(seed, Item.TABLE, 0)
        )
        self._optics = make_optics(world.camera, world.effects, world.paper.size_m)
        self.clock_s = 0.0
        self._counts = dict.fromkeys(Item, 0)
        self._gears = Gears()
        self._worn_m = 0.0
        bristles = world.tool.bristles
        self._load, self._filled, self._belly = np.zeros(bristles), np.zeros(bristles), np.zeros(1)
        self._colour = np.zeros((bristles, 6))
        self._held = False
        self.force_n = np.zeros(0)
        self._place_sheet()
        if world.tool.kind == "marker":
            self._fill(np.asarray(BLACK_SRGB), residue=0.0)

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        """Width and height of the sheet."""
        return self._world.paper.size_m

    @property
    def tool_name(self) -> str:
        """Name of the tool in the holder."""
        return self._world.tool.name

    def new_sheet(self) -> None:
        """Replace the sheet by a blank one of the same kind."""
        self._place_sheet()
        self.clock_s += SHEET_S

    def dip(self, color_srgb: ArrayLike) -> None:
        """Load the tool with paint whose masstone is about this colour, float[3] sRGB in [0,1]."""
        colour = np.asarray(color_srgb, dtype=np.float64)
        if colour.shape != (3,) or not np.all((colour >= 0) & (colour <= 1)):
            raise ContractError(f"Paint needs an sRGB colour of three numbers in [0, 1], not {color_srgb!r}.")
        self._fill(colour, residue=0.3 * float(self._load.mean()) if self._held else RINSED)
        self.clock_s += DIP_S

    def wipe(self) -> None:
        """Wash and dry the tool; a little paint stays between the bristles. A marker is not changed."""
        if self._world.tool.kind != "marker":
            self._load[:], self._belly[0] = 0.0, 0.0
            self._held = False
        self.clock_s += WIPE_S

    def stroke(self, path: NDArray[np.float64]) -> NDArray[np.float64]:
        """Execute a commanded path, float64[N,5] t_s, x_m, y_m, z_m, yaw_rad; returns the encoder readings [N,5].

        `force_n` then has what the wrist's sensor measured at the same times, float64[N].

        Raises:
            ContractError: a path of another shape, a number that is not finite, or times that do not increase.
        """
        path = _checked(path)
        world, rng = self._world, self._next(Item.STROKE)
        tip = execute(path, world.robot, world.effects, canvas_size_m=world.paper.size_m, gears=self._gears, rng=rng)
        self._gears = tip.gears
        self.clock_s += world.robot.travel_s + float(path[-1, 0] - path[0, 0])
        surface = surface_height_m(world.paper, world.effects, tip.pose[:, :2])
        friction = rng.standard_normal(len(tip.pose) + 2 * DAB_STEPS)
        moved = drag(tip, surface, world.tool, effects=world.effects, worn_m=self._worn_m, friction=friction)
        self._mark(moved)
        self._worn_m += _drawn_m(tip, surface)
        force_n = bearing_n(surface - tip.pose[:, 2], self._bundle, world.tool)
        times_s = np.linspace(path[0, 0], path[-1, 0], len(force_n))
        noise_n = world.robot.force_noise_n * rng.standard_normal(len(path))
        self.force_n = np.interp(path[:, 0], times_s, force_n) + noise_n
        return tip.encoders

    def photo(self) -> Photo:
        """Photograph the table."""
        self.clock_s += PHOTO_S
        self._look()
        frame = expose(self._scene, self._optics, self._world.camera, self._next(Item.PHOTO))
        camera = self._world.camera
        return Photo(frame, camera.exposure_s, camera.gain, np.asarray(camera.white_balance), self.clock_s)

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        if not seconds >= 0:
            raise ContractError(f"Time cannot pass by {seconds} s; wait for 0 s or longer.")
        self.clock_s += seconds

    def truth_image(self, pixels_per_m: float) -> NDArray[np.float64]:
        """The sheet without a camera, float64[H,W,3] linear light; for tests, never for a model."""
        self._look()
        width, height = (round(s * pixels_per_m) for s in self.canvas_size_m)
        interpolation = cv2.INTER_AREA if pixels_per_m <= CELLS_PER_M else cv2.INTER_LINEAR
        return cv2.resize(self._sheet_view(), (width, height), interpolation=interpolation).astype(np.float64)

    def _next(self, kind: Item) -> np.random.Generator:
        rng = item_rng(self._seed, kind, self._counts[kind])
        self._counts[kind] += 1
        return rng

    def _place_sheet(self) -> None:
        rng, paper = self._next(Item.SHEET), self._world.paper
        shape = sheet_shape(paper)
        self._grain = grain_field(paper, rng)
        self._absorbency = absorbency_field(paper, rng)
        self._wet = np.zeros((*shape, 7), dtype=np.float32)
        self._painted_s = np.zeros(shape, dtype=np.float32)
        self._seen_liquid = np.full(shape, 2.0, dtype=np.float32)
        white = srgb_to_linear(np.asarray(paper.color_srgb)).astype(np.float32)
        self._below = white * (1 + 0.02 * paper.grain * (self._grain - 0.5))[..., None]
        self._sheet_view()[:] = self._below

    def _sheet_view(self) -> NDArray[np.float32]:
        (row, column), (rows, columns) = self._corner, sheet_shape(self._world.paper)
        return self._scene[row : row + rows, column : column + columns]

    def _fill(self, color_srgb: NDArray[np.float64], residue: float) -> None:
        world, rng = self._world, self._next(Item.DIP)
        error = 1 + world.paint.mixing_error * rng.standard_normal(3)
        fresh = pigment(srgb_to_linear(color_srgb) * error, world.paint)
        mixed = np.concatenate([fresh.absorption, fresh.scattering])
        old = np.clip(residue * world.effects.wet_mixing, 0, 1) if self._colour.any() else 0.0
        self._colour[:] = (1 - old) * mixed + old * self._colour
        fill = np.clip(0.9 + 0.08 * rng.standard_normal(world.tool.bristles), 0.5, 1.0)
        self._load[:], self._filled[:] = fill, fill
        self._belly[0] = np.clip(0.95 + 0.03 * rng.standard_normal(), 0.8, 1.0)
        self._held = True

    def _mark(self, moved: Drag) -> None:
        """Lay the bundle's paint down along its drag."""
        world, tool = self._world, self._world.tool
        rows, columns = self._painted_s.shape
        centre = moved.patch * CELLS_PER_M - 0.5
        centre[:, 1] = rows - 1 - centre[:, 1]
        flip = np.array([1.0, -1.0])
        reach = 1.5 * CELLS_PER_M * float(np.abs(moved.frame).sum(axis=2).max()) + 14
        low = np.maximum(np.floor(centre.min(axis=0) - reach).astype(int), 0)
        high = np.minimum(np.ceil(centre.max(axis=0) + reach).astype(int), (columns, rows))
        if np.any(high <= low):
            return
        window = slice(low[1], high[1]), slice(low[0], high[0])
        liquid = np.exp((self._painted_s[window] - np.float32(self.clock_s)) / np.float32(world.paint.drying_s))
        film = np.zeros((*liquid.shape, 7), dtype=np.float32)
        volume = tool.capacity_m2 * CELLS_PER_M**2 / max(world.effects.ink_depletion, NO_DEPLETION)
        bristle = np.full(tool.bristles, volume * (1 - tool.belly) / tool.bristles)
        sweep(
            film, self._wet[window], liquid, self._grain[window], world.paper.grain,
            centre - low, moved.press_m, moved.frame * flip[:, None] * CELLS_PER_M, moved.outer * flip,
            moved.film, self._bundle.place, self._bundle.short_m, self._bundle.wetting,
            self._colour, self._load, self._filled, self._belly, bristle, volume * tool.belly,
            tool.bristle_radius_m * CELLS_PER_M, world.paint.pickup * world.effects.wet_mixing, tool.swell,
        )  # fmt: skip
        spread(film, self._reach_cells(moved, window), self._grain[window])
        lay_film(
            film, self._wet[window], self._below[window], self._painted_s[window],
            self.clock_s, world.paint.drying_s, world.paint.drying_loss * world.effects.drying_shift,
            world.paint.stirring * world.effects.wet_mixing,
        )  # fmt: skip
        self._seen_liquid[window][film[..., 0] > 0] = 2.0

    def _reach_cells(self, moved: Drag, window: tuple[slice, slice]) -> NDArray[np.float32]:
        """Distance that the stroke's paint flows, float32[h,w] cells: by levelling, bleed and contact time."""
        effects, tool = self._world.effects, self._world.tool
        absorbed = effects.paper_bleed * BLEED_M * self._absorbency[window]
        inside = moved.press_m > 0
        speed = max(float(np.median(moved.speed_m_s[inside])) if inside.any() else 0.0, MIN_SPEED_M_S)
        stay_s = 2 * tool.half_thickness_m / speed
        wicked = effects.speed_bleed * WICKING_M_PER_SQRT_S * np.sqrt(stay_s)
        further = np.float32(np.hypot(wicked, self._world.paint.levelling_m))
        return np.asarray(np.hypot(absorbed, further) * np.float32(CELLS_PER_M), dtype=np.float32)

    def _look(self) -> None:
        world = self._world
        refresh(
            self._sheet_view(), self._seen_liquid, self._wet, self._below, self._painted_s, self.clock_s,
            world.paint.drying_s, world.paint.drying_loss * world.effects.drying_shift,
        )  # fmt: skip


def _checked(path: NDArray[np.float64]) -> NDArray[np.float64]:
    path = np.asarray(path, dtype=np.float64)
    if path.ndim != 2 or path.shape[1] != 5 or len(path) < 2:
        raise ContractError(f"A stroke's path is [N,5] with N of 2 or more (t, x, y, z, yaw), not {path.shape}.")
    if not np.isfinite(path).all():
        raise ContractError("A stroke's path has numbers that are not finite; the studio needs times and yaws, too.")
    if not np.all(np.diff(path[:, 0]) > 0):
        raise ContractError("A stroke's times do not increase from point to point; give each point its own time.")
    return path


def _drawn_m(tip: Tip, surface_m: NDArray[np.float64]) -> float:
    steps = np.hypot(*np.diff(tip.pose[:, :2], axis=0).T)
    return float(steps[(surface_m > tip.pose[:, 2])[1:]].sum())

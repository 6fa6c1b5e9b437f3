"""The clay studio: the state of a slab, a rack of tools and a scanner, changed by commands."""

import copy
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.observations import Scan
from pentimento.studio.clay.motion import (
    RESTING_STEPS,
    commanded_line,
    encoder_path,
    executed_line,
    finger_lines,
)
from pentimento.studio.clay.pellet import lump_m
from pentimento.studio.clay.plough import plough, touched
from pentimento.studio.clay.recovery import draw_peak, elastic_m, firm_m, rise_far, run_off, spring_back
from pentimento.studio.clay.scanner import calibrated_plane, scan_height_m
from pentimento.studio.clay.slab import Air, air_at, cells_shape, fresh_surface, hardness_factor, smooth_field
from pentimento.studio.clay.world import ClayWorld, ToolShape
from pentimento.studio.shared import Gears, Item, item_rng

Array = NDArray[np.float64]

SMOOTHING_S = 45.0
TOOL_CHANGE_S = 20.0
REFERENCE_SPEED_M_S = 0.02
BULB_M = 0.003  # distance around the contact within which the material is worked, too
TOUCHED_M = 1e-4


class ClayStudio:
    """A virtual world of clay under one seed: the same commands give the same bytes."""

    def __init__(self, world: ClayWorld, seed: int) -> None:
        self._world, self._seed = world, seed
        self._shape = cells_shape(world.slab, world.scanner.pixels)
        self._cell_m = world.slab.size_m[0] / self._shape[1]
        self.clock_s = 0.0
        self.lost_m3 = 0.0
        """Volume lost to crushed pores since the last smoothing."""
        self.added_m3 = 0.0
        """Volume of the pellets since the last smoothing."""
        self._counts = dict.fromkeys(Item, 0)
        self._gears = Gears()
        self._tool_name: str | None = None
        self._plane = calibrated_plane(world.scanner, self._next(Item.TABLE))
        self._place_slab()

    def in_world(self, world: ClayWorld) -> "ClayStudio":
        """A copy of this studio in its present state, with the physics of another world of the same slab."""
        counterfactual = copy.deepcopy(self)
        counterfactual._world = world
        return counterfactual

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the tray."""
        return self._world.slab.size_m

    @property
    def material_name(self) -> str:
        """Name of the material in the tray."""
        return self._world.material.name

    def take(self, tool_name: str) -> None:
        """Take a tool from the rack."""
        if tool_name not in self._world.tools:
            raise ContractError(
                f"The rack holds no {tool_name!r}; take one of {sorted(self._world.tools)}, "
                "or add [tools.NAME] to the world file."
            )
        if tool_name != self._tool_name:
            self.clock_s += TOOL_CHANGE_S
        self._tool_name = tool_name

    def smooth(self) -> None:
        """Knead and smooth the material: its deformation is erased, its age is kept."""
        self._place_slab()
        self.clock_s += SMOOTHING_S

    def push(
        self, action: Array, surface_m: float, speed_m_s: float, dwell_s: float, retract_speed_m_s: float
    ) -> Array:
        """Push (or pinch, with a gripper): float64[5] action of the contract, from a surface of this height.

        Returns the encoder readings of the tip, float64[M,5] t_s, x_m, y_m, z_m (above the table), yaw_rad.
        """
        action = _checked(action, (surface_m, speed_m_s, dwell_s, retract_speed_m_s))
        world, rng = self._world, self._next(Item.PUSH)
        command = commanded_line(action, surface_m)
        wider = 1.0 + world.effects.speed_footprint * world.material.wake * math.tanh(
            math.log(speed_m_s / REFERENCE_SPEED_M_S)
        )
        self._press(
            self._held(), command, action, rng=rng, wider=wider, dwell_s=dwell_s, retract_speed_m_s=retract_speed_m_s
        )
        self.clock_s += world.arm.travel_s + action[3] / speed_m_s + dwell_s + 0.02 / retract_speed_m_s
        return encoder_path(command, action, speed_m_s, world.arm, rng)

    def place(self, x_m: float, y_m: float, volume_m3: float, *, surface_m: float, press_m: float) -> None:
        """Set a pellet of fresh material and press it with the pad to `press_m` above a surface of this height.

        The pellet is an oval lump of about that volume, about there. What the pad displaces heaps up around it, loses
        pores, springs back and slides as after a push.
        """
        _check_place((x_m, y_m, volume_m3, surface_m, press_m), self.size_m)
        pellets, rng = self._world.pellets, self._next(Item.PLACE)
        volume = volume_m3 * math.exp(pellets.volume_spread * rng.standard_normal())
        middle = np.array([[x_m, y_m, 0.0]])
        middle[0, :2] += pellets.place_error_m * rng.standard_normal(2)
        column, row, _ = self._cells(middle)[0]
        ratio = math.exp(0.5 * pellets.oval * rng.standard_normal())
        lump = lump_m(self._shape, (column, row), volume, ratio, rng.uniform(0.0, math.pi), self._cell_m)
        self._height += lump
        self.added_m3 += float(lump.sum()) * self._cell_m**2
        top_m = float(self._height[lump > 0.0].max())
        action = np.array([x_m, y_m, 0.0, 0.0, max(top_m - surface_m - press_m, 0.0)])
        self._press(
            pellets.pad, commanded_line(action, top_m), action, rng=rng, wider=1.0, dwell_s=pellets.dwell_s,
            retract_speed_m_s=pellets.speed_m_s, laid=lump > 0.0,
        )  # fmt: skip
        self.clock_s += pellets.set_s + 2 * action[4] / pellets.speed_m_s + pellets.dwell_s

    def scan(self) -> Scan:
        """Scan the slab."""
        self.clock_s += self._world.scanner.scan_s
        measured = scan_height_m(self._height, self.size_m, self._world.scanner, self._next(Item.SCAN))
        window = np.array([0.0, 0.0, *self.size_m])
        return Scan(measured, window, self._plane.copy(), self._world.scanner.name, self.clock_s)

    def air(self) -> Air:
        """The readings of the room's thermometer and hygrometer."""
        air = self._air(self.clock_s)
        noise = item_rng(self._seed, Item.ROOM, 1 + round(self.clock_s * 1000)).standard_normal(2)
        return Air(air.temperature_c + 0.1 * float(noise[0]), air.humidity + 0.004 * float(noise[1]))

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        if not seconds >= 0:
            raise ContractError(f"Time cannot pass by {seconds} s; wait for 0 s or longer.")
        self.clock_s += seconds

    def truth_height_m(self) -> Array:
        """The surface without a scanner, float64[rows,columns]; for tests, never for a model."""
        return self._height.copy()

    def truth_volume_m3(self) -> float:
        """Volume above the table; for tests, never for a model."""
        return float(self._height.sum()) * self._cell_m**2

    def _next(self, kind: Item) -> np.random.Generator:
        rng = item_rng(self._seed, kind, self._counts[kind])
        self._counts[kind] += 1
        return rng

    def _air(self, t_s: float) -> Air:
        return air_at(self._world.room, t_s, item_rng(self._seed, Item.ROOM, 0))

    def _held(self) -> ToolShape:
        if self._tool_name is None:
            raise ContractError("The robot's hand is empty; take a tool before the first push.")
        return self._world.tools[self._tool_name]

    def _place_slab(self) -> None:
        rng, material = self._next(Item.SLAB), self._world.material
        self._height = fresh_surface(self._world.slab, self._shape, rng)
        mottle = smooth_field(self._shape, material.mottle_m / self._cell_m, rng)
        self._hardness = material.hardness_pa * np.exp(material.mottle * mottle)
        self._rest_slope = np.maximum(1.0 + 0.07 * smooth_field(self._shape, 0.002 / self._cell_m, rng), 0.7)
        self._strain = np.zeros(self._shape)
        self.lost_m3 = self.added_m3 = 0.0

    def _cells(self, line: Array) -> Array:
        """A line float64[M,3] x_m, y_m, z_m as column, row, z_m."""
        column, row = line[:, 0] / self._cell_m - 0.5, (self.size_m[1] - line[:, 1]) / self._cell_m - 0.5
        return np.column_stack([column, row, line[:, 2]])

    def _press(
        self,
        tool: ToolShape,
        command: Array,
        action: Array,
        *,
        rng: np.random.Generator,
        wider: float,
        dwell_s: float,
        retract_speed_m_s: float,
        laid: NDArray[np.bool_] | None = None,
    ) -> None:
        """Press the tool along a commanded line and let the material come to rest.

        laid: bool[H,W], where a pellet was just laid: it settles even where the tool leaves it, and what it loses to
        its sides does not rise far away, for it lies on the surface.
        """
        world, effects = self._world, self._world.effects
        line, self._gears = executed_line(command, world.arm, effects, size_m=self.size_m, gears=self._gears, rng=rng)
        worked = 1.0 - np.exp(-self._strain / world.material.hardening_strain)
        worked *= effects.work_hardening * world.material.hardening
        air = self._air(self.clock_s)
        hardness = self._hardness * hardness_factor(world.material, effects, air, self.clock_s)
        hardness *= 1.0 + worked
        rested = 1.0 / (1.0 + effects.dwell_creep * world.material.creep * math.log1p(dwell_s))
        pre, volume = self._height.copy(), np.zeros(2)
        contacts = [
            self._plough(
                tool,
                wider,
                self._cells(finger),
                heading=heading * (1, -1),
                pre=pre,
                hardness=hardness,
                rested=rested,
                far_share=0.0 if laid is not None else min(effects.far_field * world.material.far_share, 1.0),
                volume=volume,
            )
            for finger, heading in finger_lines(tool, line, action)
        ]
        travel = np.array([math.cos(action[2]), -math.sin(action[2])])
        self._recover(pre, worked, volume, travel if tool.spread_m == 0.0 else 0.0 * travel, dwell_s)
        self._retract(contacts, dwell_s, retract_speed_m_s)
        self._settle(pre, rng, laid)

    def _plough(
        self,
        tool: ToolShape,
        wider: float,
        line: Array,
        *,
        heading: Array,
        pre: Array,
        hardness: Array,
        rested: float,
        far_share: float,
        volume: Array,
    ) -> NDArray[np.bool_]:
        """Plough with one finger; returns where it touches at the end."""
        world, effects = self._world, self._world.effects
        shape = np.array(
            [
                *(wider * m for m in (tool.half_length_m, tool.half_width_m, tool.rounding_m)),
                tool.shank,
                tool.give_m_per_pa,
            ]
        )
        tips = plough(
            self._height, pre, hardness, self._strain, line, heading, shape, self._cell_m,
            world.arm.give_m_per_n, world.material.firming_m, world.material.rim_m, world.material.bow_wave,
            min(effects.volume_loss * world.material.crush, 1.0), world.material.crushing_strain,
            far_share, rested, RESTING_STEPS, volume,
        )  # fmt: skip
        resting = np.array([line[-1, 0], line[-1, 1], tips[-1]])
        return touched(self._height, resting, heading, shape, self._cell_m)

    def _recover(self, pre: Array, worked: Array, volume: Array, travel: Array, dwell_s: float) -> None:
        """Springback, then the rise of the far field."""
        material, effects = self._world.material, self._world.effects
        setting = 0.45 * (1.0 - math.exp(-dwell_s / material.setting_s))
        dent = np.maximum(pre - self._height, 0.0)
        elastic = effects.springback * elastic_m(dent, material.rebound_m, material.rebound, setting)
        elastic += firm_m(dent, worked)
        self._height, aside_m3, lost_m3 = spring_back(
            self._height, pre, elastic, aside_m3=float(volume[1]), lost_m3=float(volume[0]), cell_m=self._cell_m
        )
        self.lost_m3 += lost_m3
        dent = np.maximum(pre - self._height, 0.0)
        if aside_m3 > 0.0 and dent.any():
            row, column = np.mgrid[: self._shape[0], : self._shape[1]]
            centre = np.array([(dent * column).sum(), (dent * row).sum()]) / dent.sum()
            weights = rise_far(self._shape, centre, travel, material.far_m, self._cell_m)
            self._height += weights * aside_m3 / self._cell_m**2

    def _retract(self, contacts: list[NDArray[np.bool_]], dwell_s: float, retract_speed_m_s: float) -> None:
        material = self._world.material
        haste = 1.0 - math.exp(-((retract_speed_m_s / material.pull_speed_m_s) ** 0.8))
        bond = (1.0 + math.log1p(dwell_s)) / (1.0 + math.log(2.0))
        peak_m = self._world.effects.adhesion_lift * material.pull_m * haste * bond
        for contact in contacts:
            self._height = draw_peak(self._height, contact, peak_m, self._cell_m)

    def _settle(self, pre: Array, rng: np.random.Generator, laid: NDArray[np.bool_] | None) -> None:
        """Steep slopes run off, the touched surface gets rough, and material around the contact is worked, too."""
        material, effects = self._world.material, self._world.effects
        changed = np.abs(self._height - pre) > TOUCHED_M
        if laid is not None:
            changed |= laid
        if changed.any():
            tear = material.tear_m * smooth_field(self._shape, 2.5e-3 / self._cell_m, rng)
            self._height += np.where(changed, tear - tear[changed].mean(), 0.0)
            if effects.slope_slide > 0.0:
                slope = self._rest_slope * min(material.repose / effects.slope_slide, material.steepest)
                run_off(self._height, changed, slope, material.avalanche, self._cell_m)
            else:
                run_off(self._height, changed, np.full(self._shape, material.steepest), 1.0, self._cell_m)
        worked = cv2.GaussianBlur(self._strain, (0, 0), BULB_M / self._cell_m, borderType=cv2.BORDER_REFLECT)
        self._strain = np.asarray(worked)


def _checked(action: Array, others: tuple[float, float, float, float]) -> Array:
    action = np.asarray(action, dtype=np.float64)
    surface_m, speed_m_s, dwell_s, retract_speed_m_s = others
    fine = action.shape == (5,) and bool(np.isfinite(action).all()) and all(math.isfinite(v) for v in others)
    if not fine or min(action[3], action[4], dwell_s) < 0 or min(surface_m, speed_m_s, retract_speed_m_s) <= 0:
        raise ContractError(
            f"A push needs five finite numbers x, y, theta, length, depth (length and depth from 0), a surface and "
            f"speeds above 0 and a dwell from 0; got {action.tolist()} and {others}."
        )
    return action


def _check_place(numbers: tuple[float, ...], size_m: tuple[float, float]) -> None:
    x_m, y_m, volume_m3, surface_m, press_m = numbers
    fine = all(math.isfinite(number) for number in numbers) and volume_m3 > 0 and surface_m > 0 and press_m >= 0
    if not fine or not (0 <= x_m <= size_m[0] and 0 <= y_m <= size_m[1]):
        raise ContractError(
            f"A pellet needs a place x, y in the tray of {size_m} m, a volume and a surface above 0 and a height from "
            f"0 to press it to; got {numbers}."
        )

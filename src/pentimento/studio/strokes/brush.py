"""A bundle of bristles: its shape at rest, and how it bends, splays and drags over the sheet."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.studio.strokes.motion import Tip
from pentimento.studio.strokes.world import Effects, Tool

MENISCUS_M = 0.00015  # paint bulges out of the tip and touches before the bristles do
CLEAR_M = -0.0012  # press (negative: above the sheet) at which no bristle touches
DAB_STEPS = 8  # steps in which the tool comes down on the sheet and leaves it
STICTION = 0.12  # a resting patch lets the bristles bend by this share more before it breaks loose
STRAIGHTENING_M = 0.005  # bent bristles straighten within this distance when press is released
FLICK = 0.03  # share of the bend that they recover in one step of leaving the sheet
BEND_WIDENING = 0.45  # swing of the outer bristles in a tight bend, over their distance from the centre
BEND_RADIUS_M = 0.014  # radius of a bend at which half of it is reached
SPEED_SCALE_M_S = 0.09  # speed at which the speed effects are half developed
_STILL_M = 1e-7  # in one step
_SMOOTHED = 15  # points, about 3 mm
WEAR_WIDENING = 0.4  # relative, of a worn-out tip

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Bundle:
    """The bristles at rest: place in units of the tip's half extents, extra height of the end, and wetting.

    place: float64[B,2] in [-1,1]; short_m: float64[B]; wetting: float64[B] relative film that it lays down.
    """

    place: Array
    short_m: Array
    wetting: Array


@dataclass(frozen=True)
class Drag:
    """Motion of the bundle's contact patch, in metres of the canvas frame.

    patch: float64[M,2] centre; press_m: float64[M]; frame: float64[M,2,2] maps a bristle's place at rest to
    its displacement from the centre; outer: float64[M,2] displacement added per unit of place on the outer
    side of a bend, film: float64[M] relative thickness of the film that is laid down; speed_m_s:
    float64[M].
    """

    patch: Array
    press_m: Array
    frame: Array
    outer: Array
    film: Array
    speed_m_s: Array


def make_bundle(tool: Tool, rng: np.random.Generator) -> Bundle:
    """Bristles over the tip's cross-section: a disc, or a superellipse for a flat tool.

    The bundle is symmetric about both axes of its cross-section, so that at every press the contact patch is centred at
    the tip. An asymmetric bundle would add offsets along and across the stroke that look like `bristle_lag`, which
    the world file does not set.
    """
    places, mirror_set = _scatter(tool, rng)
    first = places[np.unique(mirror_set, return_index=True)[1]]
    # Bristles stick together in tufts: their lengths and loads vary smoothly over the cross-section.
    tuft = _smooth_noise(first, rng)
    short = tool.dome_m * _rim_distance(tool, first) ** 2 - MENISCUS_M
    short += tool.raggedness_m * (0.85 * tuft + 0.5 * rng.standard_normal(len(first)))
    wetting = 0.85 * np.exp(0.45 * _smooth_noise(first, rng) + 0.3 * rng.standard_normal(len(first)))
    return Bundle(places, short[mirror_set], wetting[mirror_set])


def _scatter(tool: Tool, rng: np.random.Generator) -> tuple[Array, Array]:
    """Blue-noise-like places [B, 2], and the number of the mirror set of each [B].

    A mirror set is a place and its mirror images, four in all. The remainder of the bristle count is one place in the
    middle, two on the broad axis, or both. Each set is the one of six candidates that is farthest from the sets before
    it and whose places are farthest from each other.
    """
    aspect = tool.half_thickness_m / tool.half_width_m
    mirrors = np.array([[1, 1], [-1, -1], [-1, 1], [1, -1]])
    places, mirror_set = np.zeros((0, 2)), np.zeros(0, dtype=int)
    sizes = ([1] if tool.bristles % 2 else []) + ([2] if tool.bristles % 4 > 1 else []) + [4] * (tool.bristles // 4)
    for number, size in enumerate(sizes):
        candidates = rng.uniform(-1, 1, (24, 2)) * {1: (0, 0), 2: (1, 0), 4: (1, 1)}[size]
        candidates = candidates[_rim_distance(tool, candidates) <= 1][:6]
        sets = candidates[:, None] * mirrors[:size]  # [C, size, 2]
        others = np.concatenate([np.broadcast_to(places, (len(sets), *places.shape)), sets[:, 1:]], axis=1)
        gaps = np.square((candidates[:, None] - others) * (1.0, aspect)).sum(axis=2)
        best = int(np.argmax(gaps.min(axis=1, initial=np.inf)))
        places = np.concatenate([places, sets[best]])
        mirror_set = np.concatenate([mirror_set, np.full(size, number)])
    return places, mirror_set


def _rim_distance(tool: Tool, place: Array) -> Array:
    """0 in the middle, 1 at the rim; a flat tool's cross-section is a superellipse."""
    power = 5.0 if tool.kind == "flat" else 2.0
    return np.asarray((np.abs(place) ** power).sum(axis=1) ** (1 / power))


def _smooth_noise(place: Array, rng: np.random.Generator) -> Array:
    waves = rng.standard_normal((6, 2)) * 4.0
    phases = rng.uniform(0, 2 * np.pi, 6)
    return np.asarray(np.cos(place @ waves.T + phases).sum(axis=1) / np.sqrt(3.0))


def drag(tip: Tip, surface_m: Array, tool: Tool, *, effects: Effects, worn_m: float, friction: Array) -> Drag:
    """Contact patch of `tool` for a tip's motion over a surface of height float64[M].

    worn_m: length drawn in the tool's life. friction: float64[M + 2 DAB_STEPS] standard normal, the sheet's
    roughness.
    """
    xy, press, yaw, speed = _with_dabs(tip, surface_m)
    patch, bend = _drag_patch(xy, press, effects.bristle_lag * tool.trail_m, tool.splay_press_m, friction)
    heading, curvature = _course(patch)
    width = 1 + tool.splay * press / (press + tool.splay_press_m)
    width *= _speed_widening(speed, tool, effects.speed_width) * _wear_widening(worn_m, tool, effects.tool_wear)
    frame = _footprint(tool, effects, yaw, heading, bend) * width[:, None, None]
    tight = (curvature * BEND_RADIUS_M) ** 2
    swing = effects.curvature_width * BEND_WIDENING * np.sign(curvature) * tight / (1 + tight)
    outer = swing[:, None] * np.column_stack([heading[:, 1], -heading[:, 0]])
    film = _speed_thinning(speed, tool, effects.speed_density)
    return Drag(patch, press, frame, outer, film, speed)


def bearing_n(press_m: Array, bundle: Bundle, tool: Tool) -> Array:
    """Force with which the sheet bears the bundle, float64[M], for the press of its middle, float64[M].

    Each bristle is a spring that is loaded from where its own end meets the sheet.
    """
    shortened_m = np.maximum(press_m[:, None] - bundle.short_m, 0.0)
    return np.asarray(tool.stiffness_n_m * shortened_m.mean(axis=1))


class _Motion(NamedTuple):
    """A tip's motion with touch-down and lift-off, K = M + 2 DAB_STEPS."""

    xy_m: Array  # [K, 2]
    press_m: Array  # [K]
    yaw_rad: Array  # [K]
    speed_m_s: Array  # [K]


def _with_dabs(tip: Tip, surface_m: Array) -> _Motion:
    press = np.asarray(surface_m - tip.pose[:, 2])
    down, up = (np.linspace(min(CLEAR_M, end), end, DAB_STEPS, endpoint=False) for end in (press[0], press[-1]))
    press = np.concatenate([down, press, up[::-1]])

    def pad(values: Array) -> Array:
        return np.concatenate([np.repeat(values[:1], DAB_STEPS, 0), values, np.repeat(values[-1:], DAB_STEPS, 0)])

    return _Motion(pad(tip.pose[:, :2]), press, pad(tip.pose[:, 3]), pad(_blur(tip.speed_m_s, 3)))


@njit(cache=True)
def _drag_patch(tip: Array, press: Array, trail_m: float, half_press_m: float, friction: Array) -> tuple[Array, Array]:
    """Stick-slip of the patch: it sticks until the bent bristles pull hard enough, then slides towards the tip.

    Returns its centre [M,2] and the bend [M,2]: tip minus patch over the largest trail, zero without a trail.
    """
    count = press.size
    patch = tip.copy()
    bend = np.zeros((count, 2))
    if trail_m <= 0:
        return patch, bend
    x, y = tip[0, 0], tip[0, 1]
    hold, resting = 0.0, True
    for k in range(count):
        p = max(press[k], 0.0)
        target = trail_m * np.sqrt(p / (p + half_press_m))
        moved = 0.0
        if k > 0:
            moved = np.hypot(tip[k, 0] - tip[k - 1, 0], tip[k, 1] - tip[k - 1, 1])
        if target >= hold:
            hold = target
        else:
            hold += (target - hold) * (1 - (1 - FLICK) * np.exp(-moved / STRAIGHTENING_M))
        trail = hold * (1 + 0.06 * friction[k])
        dx, dy = tip[k, 0] - x, tip[k, 1] - y
        distance = np.hypot(dx, dy)
        limit = trail * (1 + STICTION) if resting else trail
        if distance > limit and distance > 0:
            slide = (distance - trail) * (0.35 if resting else 0.8)
            x += dx / distance * slide
            y += dy / distance * slide
            resting = False
        else:
            resting = True
        patch[k, 0], patch[k, 1] = x, y
        bend[k, 0], bend[k, 1] = (tip[k, 0] - x) / trail_m, (tip[k, 1] - y) / trail_m
    return patch, bend


def _course(patch: Array) -> tuple[Array, Array]:
    """Unit heading [M,2] and signed curvature [M] (left positive, 1/m) of the patch's path, smoothed over about 3 mm.

    Where the patch rests, they are those of the next moving step, or of the last one at the end.
    """
    going = np.flatnonzero(np.hypot(*np.diff(patch, axis=0).T) > _STILL_M)
    if going.size < 2:
        return np.tile((1.0, 0.0), (len(patch), 1)), np.zeros(len(patch))
    way = patch[np.append(going, going[-1] + 1)]
    # The path is extended by reflection; otherwise smoothing would bend and shorten its ends.
    size = min(_SMOOTHED, 2 * (len(way) // 4) + 1)
    beyond = np.pad(way, ((size // 2, size // 2), (0, 0)), mode="reflect", reflect_type="odd")
    smooth = np.stack([np.convolve(line, np.full(size, 1 / size), mode="valid") for line in beyond.T], axis=1)
    step = np.gradient(smooth, axis=0)
    length = np.maximum(np.hypot(step[:, 0], step[:, 1]), _STILL_M)
    heading = step / length[:, None]
    turn = heading[:, 0] * np.gradient(heading[:, 1]) - heading[:, 1] * np.gradient(heading[:, 0])
    at = np.minimum(np.searchsorted(going, np.arange(len(patch))), going.size)
    return heading[at], _blur(turn / length, _SMOOTHED)[at]


def _blur(values: Array, size: int) -> Array:
    size = min(size, 2 * (len(values) // 4) + 1)
    padded = np.pad(values, size // 2, mode="edge")
    return np.convolve(padded, np.full(size, 1 / size), mode="valid")


def _speed_widening(speed: Array, tool: Tool, strength: float) -> Array:
    """Fast bristles stiffen and have no time to spread; 1 at the reference speed."""
    reference = (tool.reference_speed_m_s / SPEED_SCALE_M_S) ** 1.4
    return np.asarray(((1 + reference) / (1 + (speed / SPEED_SCALE_M_S) ** 1.4)) ** (0.5 * strength))


def _speed_thinning(speed: Array, tool: Tool, strength: float) -> Array:
    """Viscous supply keeps up with slow strokes only; 1 at the reference speed."""
    reference = (tool.reference_speed_m_s / SPEED_SCALE_M_S) ** 2
    return np.asarray(((1 + reference) / (1 + (speed / SPEED_SCALE_M_S) ** 2)) ** (0.9 * strength))


def _wear_widening(worn_m: float, tool: Tool, strength: float) -> float:
    """A used tip spreads permanently, quickly at first."""
    return 1 + strength * WEAR_WIDENING * (1 - (1 + worn_m / tool.wear_m) ** -1.3)


def _footprint(tool: Tool, effects: Effects, yaw: Array, heading: Array, bend: Array) -> Array:
    """Matrices [M,2,2] from places at rest to metres.

    A tool without an orientation is round, of the same mean width over all headings as the oblong one.
    """
    mean = 0.5 * (tool.half_width_m + tool.half_thickness_m) if tool.kind != "flat" else 0.72 * tool.half_width_m
    half = mean * (np.array([tool.half_width_m, tool.half_thickness_m]) / mean) ** effects.orientation_width
    c, s = np.cos(yaw), np.sin(yaw)
    # Without orientation dependence the rest of the bundle's anisotropy turns with the stroke, not with the arm.
    if effects.orientation_width == 0:
        c, s = -heading[:, 1], heading[:, 0]
    frame = np.empty((len(yaw), 2, 2))
    frame[:, 0, 0], frame[:, 0, 1] = c * half[0], -s * half[1]
    frame[:, 1, 0], frame[:, 1, 1] = s * half[0], c * half[1]
    # Bent bristles lie along their bend.
    amount = np.hypot(bend[:, 0], bend[:, 1])
    axis = bend / np.maximum(amount, 1e-9)[:, None]
    stretch = (
        np.eye(2) + (tool.elongation * np.minimum(amount, 1.2))[:, None, None] * axis[:, :, None] * axis[:, None, :]
    )
    return np.asarray(stretch @ frame)

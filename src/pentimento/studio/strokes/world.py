"""A hidden world of painting: paper, camera, arm, tool, paint, effects. Metres, seconds, radians."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pentimento.studio.shared import read_world

WORLDS = Path(__file__).with_name("worlds")

ToolKind = Literal["marker", "round", "flat"]
Medium = Literal["ink", "acrylic"]


@dataclass(frozen=True)
class Paper:
    """The sheet. `grain_m` is the size of its texture, `grain` how deep it is (0 smooth, 1 rough)."""

    size_m: tuple[float, float]
    color_srgb: tuple[float, float, float]
    grain: float
    grain_m: float
    absorbency: float  # 0 sized, 1 blotting: how far liquid travels in it
    tilt_m: tuple[float, float]  # the surface's height gained from the centre to the right and to the upper border
    bow_m: float  # height of the sheet's bow above the plane at its centre


@dataclass(frozen=True)
class Camera:
    """The camera above the table and the light. Intensities are shares of the sensor's full scale."""

    pixels_per_m: float
    margin_m: float  # table seen around the sheet
    keystone: float  # perspective: relative difference of scale between the frame's near and far sides
    rotation_rad: float
    radial: tuple[float, float, float]  # k1, k2, k3 over the radius in half diagonals
    decentring: float  # offset of the lens's centre from the frame's, in half diagonals
    field_angle_rad: float  # half the angle of view at the corner: vignetting by cos^4
    gradient: tuple[float, float]  # relative light gained from the centre to the right and to the upper border
    blur_m: float
    exposure_s: float
    gain: float
    white_balance: tuple[float, float, float]
    full_well: float  # electrons at full scale: shot noise
    read_noise: float


@dataclass(frozen=True)
class Robot:
    """Errors of the arm at strength 1."""

    latency_s: float
    backlash_m: tuple[float, float]
    scale: tuple[float, float]  # executed over commanded length, per axis
    offset_m: tuple[float, float]
    encoder_noise_m: float
    force_noise_n: float
    repeatability_m: float
    travel_s: float  # between two strokes


@dataclass(frozen=True)
class Tool:
    """A bundle of bristles, or a nib's bundle of fibres. Half extents are those of the unpressed tip."""

    name: str
    kind: ToolKind
    half_width_m: float
    half_thickness_m: float
    bristles: int
    bristle_radius_m: float
    dome_m: float  # how much shorter the outermost bristles are than those in the middle
    raggedness_m: float  # spread of the bristles' lengths
    stiffness_n_m: float  # of all bristles together, along their length
    splay: float  # relative widening that press approaches
    splay_press_m: float  # press at which half of it is reached
    trail_m: float  # distance by which the bent bristles trail at high press
    elongation: float  # relative stretching of the patch along the bristles' bend
    capacity_m2: float  # area that a full load covers with a film of nominal thickness
    belly: float  # share of the load that is held above the tip and feeds it
    swell: float  # relative narrowing of the bundle when its belly is empty
    wear_m: float  # length drawn at which about half of the wear has happened
    reference_speed_m_s: float  # speed at which the speed effects neither add nor take


@dataclass(frozen=True)
class Paint:
    """The medium. Opacities refer to a film of nominal thickness."""

    medium: Medium
    scattering: float  # S times thickness of a white film (0 for a dye)
    absorption: float  # K times thickness that the darkest film approaches
    drying_s: float
    levelling_m: float  # distance over which surface tension smooths the film
    drying_loss: float  # share of the scattering that is lost when the film dries
    stirring: float  # share of a wet film that a stroke over it works in
    pickup: float  # share of a wet film that a bristle takes along at one touch
    mixing_error: float  # relative error when a colour is mixed by hand


@dataclass(frozen=True)
class Effects:
    """Strength of each cause of the diagnosis's vocabulary: 0 none, 1 realistic."""

    ink_depletion: float
    speed_width: float
    speed_density: float
    speed_bleed: float
    bristle_lag: float
    latency: float
    backlash: float
    path_scale: float
    path_offset: float
    canvas_tilt: float
    lens_distortion: float
    vignetting: float
    illumination_gradient: float
    tool_wear: float
    drying_shift: float
    wet_mixing: float
    orientation_width: float
    curvature_width: float
    paper_bleed: float


@dataclass(frozen=True)
class World:
    """Everything that is true in the studio and unknown to the robot."""

    paper: Paper
    camera: Camera
    robot: Robot
    tool: Tool
    paint: Paint
    effects: Effects


def load_world(name_or_path: str | Path) -> World:
    """World from a world file: a name such as `round_brush` (shipped), or the path of a `.toml` file.

    Raises:
        ConfigError: see `read_world`.
    """
    return read_world(World, name_or_path, WORLDS)

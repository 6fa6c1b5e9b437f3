"""A hidden world of clay: slab, material, arm, scanner, room, effects. Metres, seconds, radians.

`[tools.NAME]` of a world file is one end-effector of the rack.
"""

from dataclasses import dataclass
from pathlib import Path

from pentimento.contracts.errors import ConfigError
from pentimento.studio.shared import read_world

CLAY_WORLDS = Path(__file__).with_name("worlds")


@dataclass(frozen=True)
class Slab:
    """The material in its tray, as smoothing leaves it."""

    size_m: tuple[float, float]
    height_m: float  # above the table
    cells: int  # of the height field along the longer side; raised where the scanner is finer
    height_spread_m: float  # between two smoothings
    undulation_m: float  # slow waves that smoothing leaves (standard deviation)
    roughness_m: float  # grain (standard deviation)


@dataclass(frozen=True)
class Material:
    """The material's response. Quantities of an effect are given for its strength 1."""

    name: str
    hardness_pa: float  # pressure that a deep tool meets
    firming_m: float  # penetration over which the pressure builds up
    mottle: float  # relative spread of the hardness over the slab
    mottle_m: float
    rim_m: float  # distance over which displaced material heaps up next to the tool
    bow_wave: float  # 0: rims all round, 1: all displaced material ahead of a moving tool and at its sides
    steepest: float  # maximum slope of any surface
    tear_m: float  # roughness that the tool leaves behind it
    rebound_m: float  # springback: height that deep dents recover
    rebound: float  # springback: share of their depth that shallow dents recover
    setting_s: float  # springback: time constant of its loss during a dwell
    crush: float  # volume_loss: share of the displaced volume that is lost in fresh material
    crushing_strain: float  # volume_loss: plastic strain after which half as much is lost
    repose: float  # slope_slide: slope that it comes to rest at
    avalanche: float  # slope_slide: slope that sets it off, over `repose`
    far_share: float  # far_field: share of the displaced volume that comes up far away
    far_m: float
    hardening: float  # work_hardening: relative gain of hardness that worked material approaches
    hardening_strain: float
    pull_m: float  # adhesion_lift: height of the peak that a fast retract draws
    pull_speed_m_s: float
    drying: float  # stiffness_drift: relative gain of hardness that old material approaches
    drying_s: float
    softening_per_k: float  # stiffness_drift: relative loss of hardness for each degree above 21
    swelling: float  # humidity_softening: relative change of hardness between dry and damp air
    wake: float  # speed_footprint: relative widening of the tool's footprint between slow and fast travel
    creep: float  # dwell_creep: relative loss of hardness for each e-fold of dwell beyond a second


@dataclass(frozen=True)
class Arm:
    """Errors of the arm, and the elastic compliance of arm and slab."""

    give_m_per_n: float
    contact_error_m: float  # of the surface's height at the start of a push (standard deviation)
    repeatability_m: float
    encoder_noise_m: float
    travel_s: float  # between two pushes
    offset_m: float  # height_offset
    offset_tilt_m: tuple[float, float]  # height_offset: gained from the centre to the right and to the upper border
    backlash_m: tuple[float, float]  # tool_backlash: play of each axis


@dataclass(frozen=True)
class Scanner:
    """A structured-light scanner: a camera straight above, a projector at its side."""

    name: str
    pixels: int  # along the longer side of the slab
    noise_m: float  # on a level surface
    slope_noise: float  # growth of the noise with the squared slope
    step_m: float  # depth resolution
    elevation_rad: float  # of the projector above the table
    azimuth_rad: float  # from where it shines: 0 = from the right (+x), pi/2 = from the top (+y)
    grazing: float  # cosine between light and surface below which nothing is seen
    dropout: float  # share of pixels lost at random on a level surface
    tilt: tuple[float, float]  # of the table in the scan, per axis
    lift_m: float  # of the table at the origin in the scan
    plane_error: float  # relative error with which the scanner knows this plane
    scan_s: float


@dataclass(frozen=True)
class Room:
    """The air. Temperature and humidity drift slowly; the room's sensors measure them with a little noise."""

    temperature_c: float
    temperature_swing_k: float
    humidity: float  # relative, 0..1
    humidity_swing: float
    period_s: float


@dataclass(frozen=True)
class ClayEffects:
    """Strength of each cause, 0 none and 1 realistic: the diagnosis's vocabulary, then three causes outside it."""

    springback: float
    volume_loss: float
    slope_slide: float
    far_field: float
    work_hardening: float
    adhesion_lift: float
    stiffness_drift: float
    height_offset: float
    tool_backlash: float
    humidity_softening: float  # hardness follows the air's humidity
    speed_footprint: float  # a faster tool leaves a wider groove
    dwell_creep: float  # a tool that rests sinks deeper


@dataclass(frozen=True)
class ToolShape:
    """The true shape of an end-effector, which stands upright; x is its direction of travel at yaw 0."""

    half_length_m: float  # along travel
    half_width_m: float  # across
    rounding_m: float  # radius of the lower edges; a ball's is its half length and half width
    shank: float  # steepness of the sides above the rounding
    give_m_per_pa: float  # compliance of its surface
    spread_m: float  # a gripper's distance between its two fingers' faces when open; 0 for a single tool


@dataclass(frozen=True)
class Pellets:
    """What sets pellets of the material on the slab: its errors, and the pad that presses them flat."""

    volume_spread: float  # relative error of a pellet's volume (standard deviation)
    place_error_m: float  # of each coordinate (standard deviation)
    oval: float  # relative difference of a pellet's two widths (standard deviation)
    pad: ToolShape
    speed_m_s: float  # at which the pad is lowered and lifted
    dwell_s: float  # rest of the pad on the pellet
    set_s: float  # time for a pellet, without the motion of the pad


@dataclass(frozen=True)
class ClayWorld:
    """Everything that is true of the clay and unknown to the robot."""

    slab: Slab
    material: Material
    arm: Arm
    scanner: Scanner
    room: Room
    effects: ClayEffects
    tools: dict[str, ToolShape]
    pellets: Pellets


def load_clay_world(name_or_path: str | Path) -> ClayWorld:
    """World from a world file: a name such as `foam` (shipped), or the path of a `.toml` file.

    Raises:
        ConfigError: see `read_world`; or a size, a count or a strength out of range.
    """
    world, where = read_world(ClayWorld, name_or_path, CLAY_WORLDS), f"World file {name_or_path}"
    if min(*world.slab.size_m, world.slab.height_m) <= 0 or min(world.slab.cells, world.scanner.pixels) < 8:
        raise ConfigError(
            f"{where}: the slab is {world.slab.size_m} m by {world.slab.height_m} m high in "
            f"{world.slab.cells} cells, scanned in {world.scanner.pixels} pixels; sizes are above 0, counts at least 8."
        )
    negative = [name for name, strength in vars(world.effects).items() if strength < 0]
    if negative:
        raise ConfigError(f"{where}: the strength of {', '.join(negative)} is below 0; 0 switches it off.")
    return world

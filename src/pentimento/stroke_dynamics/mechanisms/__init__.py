"""The vocabulary of causes: what a stroke model alone may get wrong, one module each."""

from pentimento.stroke_dynamics.mechanisms.backlash import Backlash
from pentimento.stroke_dynamics.mechanisms.bristle_lag import BristleLag
from pentimento.stroke_dynamics.mechanisms.canvas_tilt import CanvasTilt
from pentimento.stroke_dynamics.mechanisms.curvature_width import CurvatureWidth
from pentimento.stroke_dynamics.mechanisms.drying_shift import DryingShift
from pentimento.stroke_dynamics.mechanisms.illumination_gradient import IlluminationGradient
from pentimento.stroke_dynamics.mechanisms.ink_depletion import InkDepletion
from pentimento.stroke_dynamics.mechanisms.latency import Latency
from pentimento.stroke_dynamics.mechanisms.lens_distortion import LensDistortion
from pentimento.stroke_dynamics.mechanisms.orientation_width import OrientationWidth
from pentimento.stroke_dynamics.mechanisms.paper_bleed import PaperBleed
from pentimento.stroke_dynamics.mechanisms.path_offset import PathOffset
from pentimento.stroke_dynamics.mechanisms.path_scale import PathScale
from pentimento.stroke_dynamics.mechanisms.speed_bleed import SpeedBleed
from pentimento.stroke_dynamics.mechanisms.speed_density import SpeedDensity
from pentimento.stroke_dynamics.mechanisms.speed_width import SpeedWidth
from pentimento.stroke_dynamics.mechanisms.tool_wear import ToolWear
from pentimento.stroke_dynamics.mechanisms.vignetting import Vignetting
from pentimento.stroke_dynamics.mechanisms.wet_mixing import WetMixing
from pentimento.stroke_dynamics.simulation import Mechanism

VOCABULARY: tuple[type[Mechanism], ...] = (
    Backlash,
    BristleLag,
    CanvasTilt,
    CurvatureWidth,
    DryingShift,
    IlluminationGradient,
    InkDepletion,
    Latency,
    LensDistortion,
    OrientationWidth,
    PaperBleed,
    PathOffset,
    PathScale,
    SpeedBleed,
    SpeedDensity,
    SpeedWidth,
    ToolWear,
    Vignetting,
    WetMixing,
)

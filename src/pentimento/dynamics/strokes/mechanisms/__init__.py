"""The vocabulary of causes of a stroke model's residual, one module each."""

from pentimento.dynamics.strokes.mechanisms.backlash import Backlash
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.canvas_tilt import CanvasTilt
from pentimento.dynamics.strokes.mechanisms.curvature_width import CurvatureWidth
from pentimento.dynamics.strokes.mechanisms.drying_shift import DryingShift
from pentimento.dynamics.strokes.mechanisms.illumination_gradient import IlluminationGradient
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.mechanisms.latency import Latency
from pentimento.dynamics.strokes.mechanisms.lens_distortion import LensDistortion
from pentimento.dynamics.strokes.mechanisms.orientation_width import OrientationWidth
from pentimento.dynamics.strokes.mechanisms.paper_bleed import PaperBleed
from pentimento.dynamics.strokes.mechanisms.path_offset import PathOffset
from pentimento.dynamics.strokes.mechanisms.path_scale import PathScale
from pentimento.dynamics.strokes.mechanisms.speed_bleed import SpeedBleed
from pentimento.dynamics.strokes.mechanisms.speed_density import SpeedDensity
from pentimento.dynamics.strokes.mechanisms.speed_width import SpeedWidth
from pentimento.dynamics.strokes.mechanisms.tool_wear import ToolWear
from pentimento.dynamics.strokes.mechanisms.vignetting import Vignetting
from pentimento.dynamics.strokes.mechanisms.wet_mixing import WetMixing
from pentimento.dynamics.strokes.simulation import Mechanism

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

"""The vocabulary of causes: effects that a push model may lack, one module each."""

from pentimento.planning.pushes.analytic.mechanisms.adhesion_lift import AdhesionLift
from pentimento.planning.pushes.analytic.mechanisms.far_field import FarField
from pentimento.planning.pushes.analytic.mechanisms.height_offset import HeightOffset
from pentimento.planning.pushes.analytic.mechanisms.mechanism import Mechanism
from pentimento.planning.pushes.analytic.mechanisms.slope_slide import SlopeSlide
from pentimento.planning.pushes.analytic.mechanisms.springback import Springback
from pentimento.planning.pushes.analytic.mechanisms.stiffness_drift import StiffnessDrift
from pentimento.planning.pushes.analytic.mechanisms.tool_backlash import ToolBacklash
from pentimento.planning.pushes.analytic.mechanisms.unnamed import ClosedStart, Sinking
from pentimento.planning.pushes.analytic.mechanisms.volume_loss import VolumeLoss
from pentimento.planning.pushes.analytic.mechanisms.work_hardening import WorkHardening

__all__ = ["UNNAMED", "VOCABULARY", "Mechanism"]

VOCABULARY: tuple[type[Mechanism], ...] = (
    AdhesionLift,
    FarField,
    HeightOffset,
    SlopeSlide,
    Springback,
    StiffnessDrift,
    ToolBacklash,
    VolumeLoss,
    WorkHardening,
)

UNNAMED: tuple[type[Mechanism], ...] = (ClosedStart, Sinking)
"""Effects that a diagnosis may fit but does not name."""

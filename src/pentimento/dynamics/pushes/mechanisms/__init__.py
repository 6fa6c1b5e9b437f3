"""The vocabulary of causes: effects that a push model may lack, one module each."""

from pentimento.dynamics.pushes.mechanisms.adhesion_lift import AdhesionLift
from pentimento.dynamics.pushes.mechanisms.far_field import FarField
from pentimento.dynamics.pushes.mechanisms.height_offset import HeightOffset
from pentimento.dynamics.pushes.mechanisms.mechanism import Mechanism
from pentimento.dynamics.pushes.mechanisms.slope_slide import SlopeSlide
from pentimento.dynamics.pushes.mechanisms.springback import Springback
from pentimento.dynamics.pushes.mechanisms.stiffness_drift import StiffnessDrift
from pentimento.dynamics.pushes.mechanisms.tool_backlash import ToolBacklash
from pentimento.dynamics.pushes.mechanisms.unnamed import ClosedStart, Sinking
from pentimento.dynamics.pushes.mechanisms.volume_loss import VolumeLoss
from pentimento.dynamics.pushes.mechanisms.work_hardening import WorkHardening

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

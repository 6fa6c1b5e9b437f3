"""The vocabulary of causes: what a push model alone may get wrong, one module each."""

from collections.abc import Mapping

from pentimento.push_dynamics.mechanisms.adhesion_lift import AdhesionLift
from pentimento.push_dynamics.mechanisms.closed_start import ClosedStart
from pentimento.push_dynamics.mechanisms.far_field import FarField
from pentimento.push_dynamics.mechanisms.height_offset import HeightOffset
from pentimento.push_dynamics.mechanisms.lower_rims import LowerRims
from pentimento.push_dynamics.mechanisms.mechanism import Mechanism
from pentimento.push_dynamics.mechanisms.sinking import Sinking
from pentimento.push_dynamics.mechanisms.slope_slide import SlopeSlide
from pentimento.push_dynamics.mechanisms.springback import Springback
from pentimento.push_dynamics.mechanisms.stiffness_drift import StiffnessDrift
from pentimento.push_dynamics.mechanisms.tool_backlash import ToolBacklash
from pentimento.push_dynamics.mechanisms.volume_loss import VolumeLoss
from pentimento.push_dynamics.mechanisms.work_hardening import WorkHardening

__all__ = ["LOOKALIKES", "VOCABULARY", "Mechanism"]

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

LOOKALIKES: Mapping[str, type[Mechanism]] = {
    "far_field": LowerRims,
    "height_offset": ClosedStart,
    "springback": Sinking,
}
"""By cause: what is none of them, and could be taken for it."""

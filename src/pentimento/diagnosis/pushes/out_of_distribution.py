"""What a diagnosis of pushes is worth on another table, which it has not seen."""

from __future__ import annotations

from pentimento.diagnosis.pushes.diagnose import PushDiagnosis
from pentimento.diagnosis.pushes.floor import noise_floor
from pentimento.diagnosis.pushes.jacobian import action_losses
from pentimento.diagnosis.pushes.measured import MeasuredPushes


def gap_closed_on(outside: MeasuredPushes, diagnosis: PushDiagnosis, seed: int) -> float | None:
    """Share of the base's error above the noise floor that the extension removes from other pushes.

    None where the floor is unknown, or no gap is above it. ``outside`` is told in the same half-widths of the footprint
    as the diagnosed pushes.

    Raises:
        NotObservable: the table lacks a column that the extended model depends on.
    """
    outside = diagnosis.learned_residual.of(outside)
    before, after = (float(action_losses(m, outside).mean()) for m in (diagnosis.base, diagnosis.extended))
    floor = noise_floor(diagnosis.extended, outside, seed) or diagnosis.floor
    if floor is None or before <= floor.mse:
        return None
    return (before - after) / (before - floor.mse)

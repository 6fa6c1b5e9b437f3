"""Part of the indentation recovers elastically: the share depends on the compression, the dwell and the time until the
scan.

A constant share is the base's ``kept``. With compression c, dwell t_d and time until the scan t_s,

    kept' = kept * (1 + a (c / (c + 5 mm) - 1/2) + b log(t_d / t_d0) - d log(t_s / t_s0)).

The recovering strain is bounded by the strain at which the material yields, so its share falls with compression. No
more recovers than was pressed. The footprint and the rims keep the width of the contact, which distinguishes recovery
from a shallower push.
"""

from __future__ import annotations

import numpy as np

from pentimento.planning.pushes.analytic.mechanisms.mechanism import (
    Array,
    Contact,
    Mechanism,
    Quantity,
    log_times,
    per_push,
    usual_s,
)
from pentimento.planning.pushes.analytic.scene import PushScene

_COMPRESSION_SCALE_M = 0.005
"""Compression at which half of the saturation is reached."""


class Springback(Mechanism):
    """See above."""

    cause = "springback"
    site = "material"
    driving_covariate = "rest"
    hidden_from_network = True
    informative_covariates = ("dwell_s",)
    quantities = (
        Quantity("kept_by_compression", "1", 0.4),
        Quantity("kept_by_log_dwell", "1", 0.1),
        Quantity("recovered_by_log_time", "1", 0.1),
    )

    @property
    def signature(self) -> tuple[str, ...]:
        """Recovery takes time. If the times vary, its dependence on them must be visible. By compression alone, any
        base that is wrong about depths looks like recovery."""
        of_time = {"dwell_s": "kept_by_log_dwell", "until_scan_s": "recovered_by_log_time"}
        shown = tuple(quantity for time, quantity in of_time.items() if time in self.reference)
        return shown or ("kept_by_compression",)

    @classmethod
    def reference_of(cls, scene: PushScene) -> dict[str, float]:
        times = {"dwell_s": usual_s(_dwell_s(scene)), "until_scan_s": usual_s(_until_scan_s(scene))}
        return {name: usual for name, usual in times.items() if usual is not None}

    def kept(self, kept_m: Array, contact: Contact, scene: PushScene) -> Array:
        by_time = np.zeros(len(scene))
        for value, name, seconds, sign in (
            (self.values[1], "dwell_s", _dwell_s(scene), 1),
            (self.values[2], "until_scan_s", _until_scan_s(scene), -1),
        ):
            if name in self.reference and seconds is not None:
                by_time = by_time + sign * value * log_times(seconds, self.reference[name])
        share = contact.pressed_m / (contact.pressed_m + np.float32(_COMPRESSION_SCALE_M))
        by_compression = np.float32(self.values[0]) * (share - np.float32(0.5))
        # A shallow indentation may recover completely, but never by more than its depth.
        return kept_m * np.maximum(1 + per_push(by_time) + by_compression, 0)


def _dwell_s(scene: PushScene) -> Array | None:
    return scene.covariates.get("dwell_s")


def _until_scan_s(scene: PushScene) -> Array | None:
    """Time [B] from the end of the push to the scan; the end follows from speed and dwell."""
    known = scene.covariates
    if not {"t_after_s", "t_start_s", "speed_m_s"} <= set(known):
        return None
    took = scene.action[:, 3] / np.maximum(known["speed_m_s"], 1e-4) + np.nan_to_num(known.get("dwell_s", 0.0))
    return np.asarray(known["t_after_s"] - known["t_start_s"] - took)

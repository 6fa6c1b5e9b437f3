"""The learned parameters of Traj2Stroke (thesis 5.3.4), each with its unit and a sentence on what it does."""

from __future__ import annotations

from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.report.html import table
from pentimento.report.wording import percent, signed_mm

_MM = 1000.0
_COMMANDED_MM = 50.0


def parameter_table(parameters: Traj2StrokeParameters, tool: str) -> str:
    """An HTML table: symbol, name, value with its unit, meaning."""
    (m_x, m_y), (b_x, b_y) = parameters.scale, parameters.offset_m
    alpha, beta_mm = parameters.thickness_per_press, parameters.thickness_at_contact_m * _MM
    rows = [
        ("<i>m</i><sub>x</sub>", "scale along x", f"{m_x:.3f}", _scaled(m_x, "across the canvas (x)")),
        ("<i>m</i><sub>y</sub>", "scale along y", f"{m_y:.3f}", _scaled(m_y, "up the canvas (y)")),
        ("<i>b</i><sub>x</sub>", "shift along x", signed_mm(b_x), _shifted(b_x, "right", "left")),
        ("<i>b</i><sub>y</sub>", "shift along y", signed_mm(b_y), _shifted(b_y, "above", "below")),
        ("<i>α</i>", "thickness per press", f"{alpha:.3f}&nbsp;mm/mm", _pressed(alpha)),
        ("<i>β</i>", "thickness at contact", f"{beta_mm:.2f} mm".replace("-", "−"), _touched(alpha, beta_mm)),
        ("<i>c</i>", "softness", f"{parameters.softness:.3f}", _soft(parameters.softness)),
        (
            "<i>ρ</i>",
            "opacity",
            f"{parameters.opacity:.3f}",
            f"On its path the mark covers {percent(parameters.opacity)} of what lies below. "
            "The thesis takes this as 100&nbsp;%.",
        ),
    ]
    caption = f"What the model learned about the {tool}. Thickness is half of a mark’s width."
    return table(("symbol", "name", "value", "what it means"), rows, caption, numbers_from=9)


def polyline_sentence(polyline: Traj2StrokeParameters, crisp: Traj2StrokeParameters) -> str:
    """The trivial model in words."""
    width_mm, crisp_mm = (2 * pen.thickness_at_contact_m * _MM for pen in (polyline, crisp))
    return (
        f"The polyline, the strongest trivial model, draws the commanded path {width_mm:.2f} mm wide at "
        f"{percent(polyline.opacity)} opacity, however hard the tool is pressed; both numbers were fitted to "
        f"the same training strokes for the least MSE. For the largest IoU, its width would be {crisp_mm:.2f} mm, "
        "and its IoU here is that one’s."
    )


def _scaled(scale: float, direction: str) -> str:
    return f"A stroke commanded {_COMMANDED_MM:.0f} mm {direction} comes out {_COMMANDED_MM * scale:.1f} mm long."


def _shifted(shift_m: float, positive: str, negative: str) -> str:
    if abs(shift_m) * _MM < 0.005:
        return "The mark lies where it was commanded."
    side = positive if shift_m > 0 else negative
    side = f"to the {side} of" if side in ("right", "left") else side
    return f"The mark lies {abs(shift_m) * _MM:.2f} mm {side} where it was commanded."


def _pressed(alpha: float) -> str:
    return f"Each millimetre of press widens the mark by {2 * alpha:.2f} mm."


def _touched(alpha: float, beta_mm: float) -> str:
    if beta_mm > 0:
        return f"The lightest touch draws a line {2 * beta_mm:.2f} mm wide."
    return f"The mark starts to widen only when the tool is pressed deeper than {-beta_mm / alpha:.2f} mm."


def _soft(softness: float) -> str:
    return (
        f"Half-way from its path to its rim, the mark covers {percent(0.5**softness)} of what it covers on the "
        "path: 100&nbsp;% is a hard edge, 50&nbsp;% an even fall."
    )

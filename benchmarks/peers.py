"""Published timings of other renderers, forward + backward on one thread, measured on other machines."""

from typing import Any

WHERE = "2 vCPU AMD EPYC (AVX-512), torch 2.13 on the CPU, float32, 1 thread"
FRIDA_S, SPLINE_FRIDA_S = 6.33, 30.0
"""400 strokes at 256²; the second extrapolated from 75 ms a stroke."""
FRIDA_MB, SPLINE_FRIDA_MB = 3698, 64_000
"""Peak memory over the start of the same; the second likewise, from 161 MB a stroke."""
FRIDA_PLAN_S = 40 * 60.0
"""400 strokes x 400 iterations at 256²."""


def _peer(name: str, canvas: str, seconds: dict[int, float], extrapolated: tuple[int, ...] = ()) -> dict[str, Any]:
    return {
        "name": name,
        "canvas": canvas,
        "points": [{"strokes": n, "s": s, "extrapolated": n in extrapolated} for n, s in seconds.items()],
    }


PEERS = [
    _peer("FRIDA", "256²", {20: 0.262, 100: 1.335, 400: FRIDA_S}),
    _peer("Spline-FRIDA, 32 points", "256²", {20: 2.40, 400: SPLINE_FRIDA_S}, (400,)),
    _peer("Learning to Paint", "128²", {20: 0.040, 100: 0.22, 400: 2.03}),
    _peer("Paint Transformer", "256²", {20: 0.46, 100: 6.6}),
    _peer("K nearest strokes (CompVis)", "256²", {20: 1.70, 100: 1.70, 400: 1.72}),
]

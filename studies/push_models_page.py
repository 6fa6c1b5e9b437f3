"""The page of `studies.push_models`: measured errors and targets, with the number of worlds of each row."""

from __future__ import annotations

from typing import Any

import numpy as np

MATERIALS = ("foam", "dough", "sand")
_BARS = {"foam": 1.5, "sand": 1.5, "dough": 2.0}
_SCORES = {"l_3d_mm2": "L_3D (mm²)", "l_viz": "L_viz", "chamfer_mm": "CD (mm)", "emd_mm": "EMD (mm)"}

Parts = dict[str, Any]


def page(worlds: list[Parts]) -> str:
    """Markdown of all parts that exist; numbers are means over worlds."""
    writers = (_held_out, _ablation, _transfer, _sizes, _outside, _pinch, _unseen)
    sections = [write(worlds) for write in writers]
    return "\n".join([_HEAD.format(worlds=len(worlds)), *(section for section in sections if section)])


_HEAD = """\
# Prediction errors of push models

Written by `python -m studies.push_models`; do not edit. Simulated worlds so far: {worlds} of 20. A world has foam,
dough and sand. Their constants and effect strengths are random and differ from the bundled files. Each material has
400 designed pushes with the ball; a quarter of the actions is held out. Numbers are means over the held-out pushes
and then over worlds. Errors are computed in the square of 10 cm around the push, in its own pose, unless a column
says *window*. *n* is the number of worlds of a row. The **floor** is the noise floor: the variance of the height
change of an action that is repeated three times on freshly smoothed material. It includes the noise of both scans.
"""


def _held_out(worlds: list[Parts]) -> str:
    lines = [
        "## Held-out pushes, compared with trivial models\n",
        "| material | n | model | mean footprint | no change | window: model | window: no change |",
        "|---|---|---|---|---|---|---|",
    ]
    for material in (*MATERIALS, "pinch"):
        found = _of(worlds, f"both_{material}")
        if found:
            held = [part["held_out"] for part in found]
            lines.append(
                f"| {_name(material)} | {len(found)} | {_mean(held, 'model', 'l_3d_mm2')} | "
                f"{_mean(held, 'mean_footprint', 'l_3d_mm2')} | {_mean(held, 'unchanged', 'l_3d_mm2')} | "
                f"{_mean(held, 'model', 'window_l_3d_mm2')} | {_mean(held, 'unchanged', 'window_l_3d_mm2')} |"
            )
    lines += [
        "\nL_3D in mm². The next table uses only the repeated held-out actions, "
        "so that error and floor are of the same pushes:\n",
        "| material | n | model | floor | model / floor | target | window: model / floor |",
        "|---|---|---|---|---|---|---|",
    ]
    for material in (*MATERIALS, "pinch"):
        found = [part["held_out_repeats"] for part in _of(worlds, f"both_{material}")]
        if found:
            over, window = (_ratio(found, name) for name in ("l_3d_mm2", "window_l_3d_mm2"))
            bar = f"≤ {_BARS[material]} {_met(over <= _BARS[material])}" if material in _BARS else "–"
            lines.append(
                f"| {_name(material)} | {len(found)} | {_mean(found, 'model', 'l_3d_mm2')} | "
                f"{_mean(found, 'floor', 'l_3d_mm2')} | {over:.2f} | {bar} | {window:.2f} |"
            )
    lines.append(
        "\nThe model does not know dwell time and speeds, which differ between actions but not between repeats. Of\n"
        "earlier pushes it knows only the resulting shape. The error above the floor is what the diagnosis explains."
    )
    return "\n".join(lines) + "\n"


def _ablation(worlds: list[Parts]) -> str:
    lines = [
        "## Training with L_3D alone and with L_3D + L_viz (table 7.1)\n",
        "| material | n | trained on | " + " | ".join(_SCORES.values()) + " |",
        "|---|---|---|" + "---|" * len(_SCORES),
    ]
    better = {"visual": 0, "3d": 0, "of": 0}
    for material in MATERIALS:
        pairs = [world for world in worlds if {f"3d_{material}", f"both_{material}"} <= set(world)]
        rows = {losses: [world[f"{losses}_{material}"]["held_out"] for world in pairs] for losses in ("3d", "both")}
        if not pairs:
            continue
        for losses, label in (("3d", "L_3D"), ("both", "L_3D + L_viz")):
            scores = " | ".join(_mean(rows[losses], "model", score) for score in _SCORES)
            lines.append(f"| {material} | {len(pairs)} | {label} | {scores} |")
        means = {k: {s: np.mean([r["model"][s] for r in rows[k]]) for s in _SCORES} for k in rows}
        better["of"] += 1
        better["visual"] += bool(means["both"]["l_viz"] < means["3d"]["l_viz"])
        better["3d"] += bool(means["both"]["l_3d_mm2"] <= means["3d"]["l_3d_mm2"])
    if not better["of"]:
        return ""
    lines.append(
        f"\nWith L_viz the visual error is lower on {better['visual']} of {better['of']} materials, and the 3D error "
        f"no higher on {better['3d']} of {better['of']} (targets: all; at least 2 of 3)."
    )
    return "\n".join(lines) + "\n"


def _transfer(worlds: list[Parts]) -> str:
    found = _of(worlds, "transfer")
    if not found:
        return ""
    lines = [
        f"## Trained on one material, tested on another (figure 7.6): L_3D, mm², n = {len(found)}\n",
        "| tested on | " + " | ".join(f"trained on {name}" for name in MATERIALS) + " |",
        "|---|" + "---|" * len(MATERIALS),
    ]
    for on in MATERIALS:
        lines.append(f"| {on} | " + " | ".join(_mean(found, on, name) for name in MATERIALS) + " |")
    return "\n".join(lines) + "\n"


def _sizes(worlds: list[Parts]) -> str:
    sizes = sorted({int(name.split("_")[1]) for world in worlds for name in world if name.startswith("size_")})
    if not sizes:
        return ""
    lines = [
        "## Sample efficiency (figure 7.8): held-out L_3D, mm²\n",
        "| material | n | " + " | ".join(f"{size} pushes" for size in sizes) + " | all of training |",
        "|---|---|" + "---|" * (len(sizes) + 1),
    ]
    for material in MATERIALS:
        names = [f"size_{size}_{material}" for size in sizes]
        whole = [world for world in worlds if {*names, f"both_{material}"} <= set(world)]
        if whole:
            cells = [f"{np.mean([world[name]['l_3d_mm2'] for world in whole]):.4f}" for name in names]
            last = np.mean([world[f"both_{material}"]["held_out"]["model"]["l_3d_mm2"] for world in whole])
            lines.append(f"| {material} | {len(whole)} | {' | '.join(cells)} | {last:.4f} |")
    return "\n".join(lines) + "\n"


def _outside(worlds: list[Parts]) -> str:
    rows = []
    for material in MATERIALS:
        found = _of(worlds, f"outside_{material}")
        if found:
            means = [np.mean([part[key] for part in found]) for key in ("within", "beyond", "beyond_by_all")]
            rows.append(f"| {material} | {len(found)} | " + " | ".join(f"{mean:.4f}" for mean in means) + " |")
    if not rows:
        return ""
    lines = [
        "## Outside the training region: held-out L_3D, mm²\n",
        "The first model is trained only on pushes of at most 25 mm length and 8 mm depth. The "
        "last column is the model that was trained on all.\n",
        "| material | n | within | beyond | beyond, trained on all |",
        "|---|---|---|---|---|",
        *rows,
    ]
    return "\n".join(lines) + "\n"


def _pinch(worlds: list[Parts]) -> str:
    pairs = [world for world in worlds if {"both_pinch", "both_foam"} <= set(world)]
    if not pairs:
        return ""
    lines = [
        f"## Pushes and pinches in foam (table 7.1), n = {len(pairs)}\n",
        "| action | " + " | ".join(_SCORES.values()) + " | L_3D of no change | L_3D / no change |",
        "|---|" + "---|" * (len(_SCORES) + 2),
    ]
    for name, label in (("both_foam", "push (ball)"), ("both_pinch", "pinch (gripper)")):
        held = [world[name]["held_out"] for world in pairs]
        share = np.mean([part["model"]["l_3d_mm2"] / part["unchanged"]["l_3d_mm2"] for part in held])
        scores = " | ".join(_mean(held, "model", score) for score in _SCORES)
        lines.append(f"| {label} | {scores} | {_mean(held, 'unchanged', 'l_3d_mm2')} | {share:.3f} |")
    return "\n".join(lines) + "\n"


def _unseen(worlds: list[Parts]) -> str:
    lines = []
    both = [world for world in worlds if {"conditioned", "longer", "transfer"} <= set(world)]
    if both:
        lines += [
            f"## One model for all materials: L_3D, mm², n = {len(both)}\n",
            "In training, the conditioned model sees each push of a material five times where a material's own model\n"
            "sees it three times. *own, longer* are own models with five times.\n",
            "| material | own model | own, longer | conditioned | conditioned / own | conditioned / own, longer |",
            "|---|---|---|---|---|---|",
        ]
        for name in MATERIALS:
            own, longer, shared = (
                float(np.mean([world[part][name][name] if part == "transfer" else world[part][name] for world in both]))
                for part in ("transfer", "longer", "conditioned")
            )
            lines.append(
                f"| {name} | {own:.4f} | {longer:.4f} | {shared:.4f} | {shared / own:.2f} | {shared / longer:.2f} |"
            )
    rows = []
    for name in MATERIALS:
        found = [world for world in worlds if {f"unseen_{name}", "transfer"} <= set(world)]
        if found:
            best = np.mean([min(v for k, v in world["transfer"][name].items() if k != name) for world in found])
            full = np.mean([world["transfer"][name][name] for world in found])
            few = {
                k: np.mean([world[f"unseen_{name}"][k] for world in found]) for k in ("adapted", "alone", "unadapted")
            }
            rows.append(
                f"| {name} | {len(found)} | {best:.4f} | {few['unadapted']:.4f} | {few['alone']:.4f} | "
                f"{few['adapted']:.4f} | {few['adapted'] / best:.2f} "
                f"{_met(few['adapted'] <= 0.5 * best)} | {full:.4f} |"
            )
    if rows:
        lines += [
            "\n## An unseen material with 20 pushes: L_3D, mm²\n",
            "The conditioned model of the two other materials is adapted on 20 pushes: first its context and last\n"
            "layer, then all parameters at a low learning rate. The target is half the error of the best own model of\n"
            "another material.\n",
            "| unseen | n | best other's model | two others, not adapted | trained on 20 pushes only | adapted on 20 | "
            "adapted / best other (target ≤ 0.5) | own model, all pushes |",
            "|---|---|---|---|---|---|---|---|",
            *rows,
        ]
    return "\n".join(lines) + "\n" if lines else ""


def _of(worlds: list[Parts], part: str) -> list[Any]:
    return [world[part] for world in worlds if part in world]


def _mean(found: list[Any], outer: str, inner: str) -> str:
    return f"{np.mean([part[outer][inner] for part in found]):.{5 if inner == 'l_viz' else 4}f}"


def _ratio(found: list[Any], name: str) -> float:
    """Of the means, so that a world with a small floor does not count for more."""
    return float(np.mean([part["model"][name] for part in found]) / np.mean([part["floor"][name] for part in found]))


def _met(met: bool) -> str:
    return "(met)" if met else "(not met)"


def _name(material: str) -> str:
    return "foam, pinch" if material == "pinch" else material

"""The page of `studies.push_models`: measured errors and targets, with the number of worlds of each row."""

from __future__ import annotations

from typing import Any

from pentimento.contracts.statistics import Estimate
from studies.student_t import mean_interval

MATERIALS = ("foam", "dough", "sand")
_BARS = {"foam": 1.2, "sand": 1.15, "dough": 1.4}
_OWN_BAR, _UNSEEN_BAR = 1.02, 0.5
_SCORES = {"l_3d_mm2": "L_3D (mm²)", "l_viz": "L_viz", "chamfer_mm": "CD (mm)", "emd_mm": "EMD (mm)"}

Parts = dict[str, Any]
Keys = tuple[str, ...]
"""Keys that lead to a number, or to several, in the parts of a world."""

_MODELS: dict[str, Keys] = {
    "param2deform": ("both", "held_out", "model"),
    "U-Net without the warp": ("unet", "held_out"),
    "analytic plough": ("plough", "held_out"),
    "mean footprint": ("both", "held_out", "mean_footprint"),
    "no change": ("both", "held_out", "unchanged"),
}
"""Where the held-out scores of each model are; the first key goes before the material's name."""


def page(worlds: list[Parts]) -> str:
    """Markdown of all parts that exist; numbers are means over worlds with 95 % intervals."""
    writers = (_held_out, _over_floor, _ablation, _transfer, _sizes, _outside, _pinch, _conditioned, _unseen)
    sections = [write(worlds) for write in writers]
    return "\n".join([_HEAD.format(worlds=len(worlds)), *(section for section in sections if section)])


_HEAD = """\
# Prediction errors of push models

Written by `python -m studies.push_models`; do not edit. Simulated worlds: {worlds}. Each world has foam, dough
and sand, with random constants and effect strengths that differ from the bundled files. Each material has 400 designed
pushes with the ball; a quarter of the actions is held out. Errors are computed in a square of 10 cm in the frame of the
push, or over the whole scan where a column says *window*.

Numbers are means over the held-out pushes, then over the *n* worlds that have the row's models, with the 95 % interval
of the mean over worlds (Student's t). A ratio of two models is computed in each world, so that its interval is paired.
A target is **met** if the whole interval satisfies it, and *met by the mean* if only the mean does.
"""


def _held_out(worlds: list[Parts]) -> str:
    rows = []
    for material in (*MATERIALS, "pinch"):
        own = _of(material, _MODELS["param2deform"])
        for name, of in _MODELS.items():
            path = _of(material, of)
            found = _having(worlds, path)
            if found:
                both = _having(found, own)
                ratio = _ratio(both, (*own, "l_3d_mm2"), (*path, "l_3d_mm2")) if both and path != own else None
                cells = [_mean(found, (*path, score)) for score in ("l_3d_mm2", "l_viz", "window_l_3d_mm2")]
                rows.append(
                    f"| {_name(material)} | {name} | {len(found)} | {_cell(cells[0])} | {_cell(cells[1], 5)} | "
                    f"{_cell(ratio, 3)} | {_cell(cells[2])} |"
                )
    lines = [
        "## Held-out pushes, compared with simpler models\n",
        "| material | model | n | L_3D (mm²) | L_viz | L_3D, param2deform / model | window: L_3D (mm²) |",
        "|---|---|---|---|---|---|---|",
        *rows,
        "\nThe *U-Net without the warp* predicts the change in the scan's own frame, around the start of the push,\n"
        "from channels with the heights and the action. It has 5 % more weights than param2deform, the same loss and\n"
        "number of training pushes, and augmentation by mirror images and rotations by 90°. The *analytic plough* is\n"
        "the volume swept by the end-effector, of which a fraction springs back and a fraction forms rims: eight\n"
        "parameters, fitted by least squares. *Mean footprint* is the mean change of the training pushes in their\n"
        "frames.",
    ]
    return "\n".join(lines) + "\n" if rows else ""


def _over_floor(worlds: list[Parts]) -> str:
    rows = []
    for material in (*MATERIALS, "pinch"):
        repeats = (f"both_{material}", "held_out_repeats")
        found = _having(worlds, repeats)
        if found:
            model, floor = (_mean(found, (*repeats, of, "l_3d_mm2")) for of in ("model", "floor"))
            over, window = (
                _ratio(found, (*repeats, "model", score), (*repeats, "floor", score))
                for score in ("l_3d_mm2", "window_l_3d_mm2")
            )
            bar = f"≤ {_BARS[material]} ({_met(over, _BARS[material])})" if material in _BARS else "–"
            rows.append(
                f"| {_name(material)} | {len(found)} | {_cell(model)} | {_cell(floor)} | {_cell(over, 2)} | {bar} | "
                f"{_cell(window, 2)} |"
            )
    lines = [
        "## Error over the noise floor\n",
        "The **floor** is the variance of the height change of an action that is repeated three times on freshly\n"
        "smoothed material. It includes the noise of both scans. Model and floor are evaluated on the same pushes,\n"
        "the repeated held-out ones.\n",
        "| material | n | model: L_3D (mm²) | floor (mm²) | model / floor | target | window: model / floor |",
        "|---|---|---|---|---|---|---|",
        *rows,
        "\nThe model's input has neither dwell time nor speeds, which differ between actions but not between repeats,\n"
        "and of earlier pushes only the resulting relief. The diagnosis explains the error above the floor.",
    ]
    return "\n".join(lines) + "\n" if rows else ""


def _ablation(worlds: list[Parts]) -> str:
    rows, ratios = [], []
    for material in MATERIALS:
        paths = {losses: (f"{losses}_{material}", "held_out", "model") for losses in ("3d", "both")}
        found = _having(worlds, *paths.values())
        if not found:
            continue
        for losses, label in (("3d", "L_3D"), ("both", "L_3D + L_viz")):
            rows.append(f"| {material} | {len(found)} | {label} | {_all_scores(found, paths[losses])} |")
        visual, height = (
            _ratio(found, (*paths["both"], score), (*paths["3d"], score)) for score in ("l_viz", "l_3d_mm2")
        )
        equal = "lower" if height.high < 1 else "higher" if height.low > 1 else "no difference shown"
        ratios.append(
            f"| {material} | {len(found)} | {_cell(visual, 3)} | < 1 ({_met(visual, 1.0)}) | {_cell(height, 3)} | "
            f"{equal if len(found) > 1 else '–'} |"
        )
    lines = [
        "## Training with L_3D alone and with L_3D + L_viz (table 7.1)\n",
        "| material | n | trained on | " + " | ".join(_SCORES.values()) + " |",
        "|---|---|---|" + "---|" * len(_SCORES),
        *rows,
        "\nRatio of the errors, trained with L_viz to without, paired by world:\n",
        "| material | n | L_viz, with / without | target | L_3D, with / without | change of L_3D |",
        "|---|---|---|---|---|---|",
        *ratios,
    ]
    return "\n".join(lines) + "\n" if rows else ""


def _transfer(worlds: list[Parts]) -> str:
    found = _having(worlds, ("transfer",))
    if not found:
        return ""
    lines = [
        f"## Trained on one material, tested on another (figure 7.6): L_3D, mm², n = {len(found)}\n",
        "| tested on | " + " | ".join(f"trained on {name}" for name in MATERIALS) + " |",
        "|---|" + "---|" * len(MATERIALS),
    ]
    for on in MATERIALS:
        cells = [_cell(_mean(found, ("transfer", on, name))) for name in MATERIALS]
        lines.append(f"| {on} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _sizes(worlds: list[Parts]) -> str:
    sizes = sorted({int(name.split("_")[1]) for world in worlds for name in world if name.startswith("size_")})
    rows = []
    for material in MATERIALS:
        paths = [(f"size_{size}_{material}", "l_3d_mm2") for size in sizes]
        whole = (f"both_{material}", "held_out", "model", "l_3d_mm2")
        found = _having(worlds, *paths, whole)
        if sizes and found:
            cells = [_cell(_mean(found, path)) for path in (*paths, whole)]
            rows.append(f"| {material} | {len(found)} | {' | '.join(cells)} |")
    lines = [
        "## Sample efficiency (figure 7.8): held-out L_3D, mm²\n",
        "| material | n | " + " | ".join(f"{size} pushes" for size in sizes) + " | all of training |",
        "|---|---|" + "---|" * (len(sizes) + 1),
        *rows,
    ]
    return "\n".join(lines) + "\n" if rows else ""


def _outside(worlds: list[Parts]) -> str:
    rows = []
    for material in MATERIALS:
        part = f"outside_{material}"
        found = _having(worlds, (part,))
        if found:
            cells = [_cell(_mean(found, (part, key))) for key in ("within", "beyond", "beyond_by_all")]
            rows.append(f"| {material} | {len(found)} | {' | '.join(cells)} |")
    lines = [
        "## Outside the training region: held-out L_3D, mm²\n",
        "The first two columns are of a model trained only on pushes of less than 25 mm length and 8 mm depth "
        "(*inside*), the last of the model trained on all.\n",
        "| material | n | inside | outside | outside, trained on all |",
        "|---|---|---|---|---|",
        *rows,
    ]
    return "\n".join(lines) + "\n" if rows else ""


def _pinch(worlds: list[Parts]) -> str:
    paths = {"push (ball)": ("both_foam", "held_out"), "pinch (gripper)": ("both_pinch", "held_out")}
    found = _having(worlds, *paths.values())
    lines = [
        f"## Pushes and pinches in foam (table 7.1), n = {len(found)}\n",
        "| action | " + " | ".join(_SCORES.values()) + " | L_3D of no change | L_3D, model / no change |",
        "|---|" + "---|" * (len(_SCORES) + 2),
    ]
    for label, path in paths.items() if found else ():
        model, unchanged = ((*path, of, "l_3d_mm2") for of in ("model", "unchanged"))
        lines.append(
            f"| {label} | {_all_scores(found, (*path, 'model'))} | {_cell(_mean(found, unchanged))} | "
            f"{_cell(_ratio(found, model, unchanged), 3)} |"
        )
    return "\n".join(lines) + "\n" if found else ""


def _conditioned(worlds: list[Parts]) -> str:
    rows = []
    for name in MATERIALS:
        paths = ("transfer", name, name), ("conditioned", name)
        found = _having(worlds, *paths)
        if found:
            own, shared = (_mean(found, path) for path in paths)
            ratio = _ratio(found, paths[1], paths[0])
            longer = _having(found, ("longer", name))
            cells = [_cell(own), _cell(shared), _cell(ratio, 3), f"≤ {_OWN_BAR} ({_met(ratio, _OWN_BAR)})"]
            over_longer = _ratio(longer, paths[1], ("longer", name)) if longer else None
            rows.append(f"| {name} | {len(found)} | {' | '.join(cells)} | {len(longer)} | {_cell(over_longer, 3)} |")
    lines = [
        "## One model for all materials: L_3D, mm²\n",
        "*Own* models are trained on one material, the *conditioned* model on all three, with five thirds of the\n"
        "passes over each push. *Own, longer* models are own models with as many passes as the conditioned one.\n",
        "| material | n | own model | conditioned | conditioned / own | target | n | conditioned / own, longer |",
        "|---|---|---|---|---|---|---|---|",
        *rows,
    ]
    return "\n".join(lines) + "\n" if rows else ""


def _unseen(worlds: list[Parts]) -> str:
    rows = []
    for name in MATERIALS:
        part = f"unseen_{name}"
        found = _having(worlds, (part,), ("transfer",))
        if found:
            best = [min(v for k, v in world["transfer"][name].items() if k != name) for world in found]
            ratio = mean_interval([world[part]["adapted"] / of for world, of in zip(found, best, strict=True)])
            own = mean_interval([world["transfer"][name][name] / of for world, of in zip(found, best, strict=True)])
            last = f"{_cell(_mean(found, ('transfer', name, name)))} | {_cell(own, 2)}"
            few = [_cell(_mean(found, (part, key))) for key in ("unadapted", "alone", "adapted")]
            rows.append(
                f"| {name} | {len(found)} | {_cell(mean_interval(best))} | {' | '.join(few)} | {_cell(ratio, 2)} | "
                f"≤ {_UNSEEN_BAR} ({_met(ratio, _UNSEEN_BAR)}) | {last} |"
            )
    lines = [
        "## An unseen material with 20 pushes: L_3D, mm²\n",
        "The conditioned model of the two other materials is fine-tuned on 20 pushes: first its context and last\n"
        "layer, then all parameters at a low learning rate. The baseline *best other* is the better of the two other\n"
        "materials' own models; the target is half its error. The last column is that ratio for the material's own\n"
        "model, trained on all its training pushes: 20 pushes can hardly reach less.\n",
        "| unseen | n | best other | conditioned, not fine-tuned | trained on 20 pushes only | fine-tuned on 20 | "
        "fine-tuned / best other | target | own model, all pushes | own / best other |",
        "|---|---|---|---|---|---|---|---|---|---|",
        *rows,
    ]
    return "\n".join(lines) + "\n" if rows else ""


def _all_scores(worlds: list[Parts], path: Keys) -> str:
    """Cells of all scores of one model."""
    return " | ".join(_cell(_mean(worlds, (*path, score)), 5 if score == "l_viz" else 4) for score in _SCORES)


def _of(material: str, path: Keys) -> Keys:
    return (f"{path[0]}_{material}", *path[1:])


def _having(worlds: list[Parts], *paths: Keys) -> list[Parts]:
    """The worlds that have all of these."""
    return [world for world in worlds if all(_there(world, path) for path in paths)]


def _there(world: Any, path: Keys) -> bool:
    return not path or (path[0] in world and _there(world[path[0]], path[1:]))


def _at(world: Any, path: Keys) -> Any:
    for key in path:
        world = world[key]
    return world


def _mean(worlds: list[Parts], path: Keys) -> Estimate:
    return mean_interval([_at(world, path) for world in worlds])


def _ratio(worlds: list[Parts], over: Keys, under: Keys) -> Estimate:
    return mean_interval([_at(world, over) / _at(world, under) for world in worlds])


def _cell(estimate: Estimate | None, digits: int = 4) -> str:
    """Mean and half-width of its interval; the mean alone in one world."""
    if estimate is None:
        return "–"
    half = estimate.high - estimate.value
    return f"{estimate.value:.{digits}f}" + (f" ± {half:.{digits}f}" if half == half else "")


def _met(estimate: Estimate, most: float) -> str:
    """Whether a target of at most ``most`` is met."""
    if estimate.high <= most:
        return "**met**"
    return "met by the mean" if estimate.value <= most else "not met"


def _name(material: str) -> str:
    return "foam, pinch" if material == "pinch" else material

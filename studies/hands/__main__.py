"""TrajVAE on strokes that people drew: `python -m studies.hands --measured DIR --out DIR`.

For the motion capture and the tablet: each session that is long enough is held out, few of its strokes adapt the model,
the rest is measured. For Quick, Draw!, where each drawing is another person's: drawings are held out. The page, its
figures and `hands.json` are written to `--out`.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pentimento.contracts.images import write_png
from pentimento.handwriting.demonstrated import Demonstrated, demonstrated
from pentimento.handwriting.evaluation import mean_stroke_mm, nearest_mm, reconstruction_mm
from pentimento.handwriting.figures import drawn_map, flat_map, sheet, sheet_of_repaired
from pentimento.handwriting.gather import Gathered, gather
from pentimento.handwriting.repair import Limits
from pentimento.handwriting.training import Course, TrajVAEConfig, pretrain
from pipelines._io import write_json
from studies.hands.by_number import auc_by_known_strokes
from studies.hands.held_out import SAMPLERS, SessionResult, held_out_sessions, pretrained_without, told_apart
from studies.hands.page import page
from studies.hands.recordings import motion_capture, quickdraw, tablet

POINTS, FEW, MIN, DRAWINGS, SEED = 32, 20, 10, 300, 1
LIMITS = Limits(max_gap_samples=5, jump_m=3e-3, jump_factor=8.0, shortest_m=1e-3, longest_m=0.6)
CONFIG = TrajVAEConfig(
    points=POINTS, latent=64, width=256, kl_weight=1e-4, pretraining=Course(3000, 64, 1e-3),
    fine_tuning=Course(400, 64, 3e-4), augmentation_std=0.05, seed=SEED,
)  # fmt: skip
_SHOWN = 12
_MAPPED = 300


def main(arguments: argparse.Namespace) -> None:
    """Run all three parts and write the page."""
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    found: dict[str, Any] = {}
    for name, read in (("motion_capture", motion_capture), ("tablet", tablet)):
        gathered = gather(read(arguments.measured), LIMITS, POINTS)
        strokes = demonstrated(gathered.table, POINTS)
        models = pretrained_without(strokes, FEW + MIN, CONFIG)
        results = held_out_sessions(models, strokes, FEW, CONFIG)
        _pictures(name, gathered, strokes, results, out)
        found[name] = {
            "gathered": gathered.counts,
            "sessions": [_numbers(result) for result in results],
            "auc": told_apart(results, SEED),
            "auc_by_number": [asdict(result) for result in auc_by_known_strokes(models, strokes, CONFIG)],
        }
        print(f"{name}: done")
    found["quickdraw"] = _quickdraw(arguments.measured)
    write_json(out / "hands.json", found)
    (out / "hands.md").write_text(page(found, FEW), encoding="utf-8")


def _numbers(result: SessionResult) -> dict[str, Any]:
    return {
        "session": result.session, "measured": result.measured, "pretrained_mm": result.pretrained_mm,
        "fine_tuned_mm": result.fine_tuned_mm, "nearest_mm": result.nearest_mm,
        "mean_stroke_mm": result.mean_stroke_mm,
    }  # fmt: skip


def _pictures(name: str, gathered: Gathered, strokes: Demonstrated, results: list[SessionResult], out: Path) -> None:
    """People beside samples, two rows a session; what was dropped; the latent space."""
    shown = [path for r in results for part in (r.rest_m, r.samples_m[SAMPLERS[0]]) for path in part[:_SHOWN]]
    write_png(out / f"{name}_samples.png", sheet(shown))
    write_png(out / f"{name}_dropped.png", sheet_of_repaired(gathered.repaired))
    every = max(-(-len(strokes.hand) // _MAPPED), 1)
    few = strokes.pick(np.arange(0, len(strokes.hand), every))
    model = pretrain(strokes.strokes, CONFIG, lambda *_: None)
    with torch.no_grad():
        latents = model.encode(few.strokes)[0].double().numpy()
    write_png(out / f"{name}_map.png", drawn_map(flat_map(latents, SEED), few.strokes.xy_m.double().numpy(), few.hand))


def _quickdraw(folder: Path) -> dict[str, Any]:
    """A tenth of the drawings held out; no hand to adapt to."""
    gathered = gather(quickdraw(folder, DRAWINGS), LIMITS, POINTS)
    strokes = demonstrated(gathered.table, POINTS)
    names = list(dict.fromkeys(strokes.session))
    apart = np.isin(np.array(strokes.session), names[::10])
    learned, held_out = strokes.pick(~apart).strokes, strokes.pick(apart).strokes
    model = pretrain(learned, CONFIG, lambda *_: None)
    return {
        "gathered": {name: count for name, count in gathered.counts.items() if name != "hands"},
        "measured": len(held_out.xy_m),
        "pretrained_mm": reconstruction_mm(model, held_out),
        "nearest_mm": nearest_mm(learned, held_out),
        "mean_stroke_mm": mean_stroke_mm(learned, held_out),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="studies.hands", description=__doc__)
    parser.add_argument("--measured", required=True, type=Path, help="folder of the measured trajectories (.npz)")
    parser.add_argument("--out", required=True, type=Path)
    main(parser.parse_args())

"""The alphabet, each letter in a slab of its own, or in one slab that is never smoothed (thesis 7.4.2, Figure 7.1).

`python -m studies.sculpting.alphabet --material dough --tool ball --models DIR --out letters_dough_1` sculpts A to Z,
each in a new slab. `--one-slab --letters ABCDEF --rising-share .1 --out alphabet_foam_1` sculpts up to six letters in
one slab, each deeper than the one before it. Both continue after the last finished letter; in one slab, the recorded
pushes of the finished letters are first repeated, so that the slab is the same.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from string import ascii_uppercase
from typing import Any

import matplotlib
import numpy as np
import torch

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.images import write_png
from pentimento.control.execute import Session
from pentimento.control.execute_push import execute_push
from pentimento.control.sculptor import sculpt, seen_m
from pentimento.goals3d.evaluation import goal_errors
from pentimento.goals3d.shading import photograph
from pentimento.goals3d.sources import relief_of
from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.goal import fit_goal
from pentimento.robots.driver import SculptingRobot
from pentimento.robots.tools import EndEffector
from pentimento.semantics.letter_classifier import LetterClassifier, classify_sculpture
from studies.sculpting.clay import Settings, model_of, robot_with, settings

ONE_SLAB_DEPTH_M = (0.0015, 0.002, 0.0027, 0.0036, 0.005, 0.0095)
"""Depths of the letters in one slab, in order. Pushes only lower the foam, so that a letter stays visible and the next
one must be deeper. An F needs much more depth, because it is the E before it without its lowest line."""
DEPTH_M = 0.005
"""Depth of each letter in a slab of its own."""
_FONTS = ("STIXGeneral.ttf", "STIXGeneralBol.ttf", "cmr10.ttf", "cmss10.ttf", "cmb10.ttf")
"""Of Matplotlib; goals have its DejaVu Serif."""


def main(arguments: argparse.Namespace) -> None:
    """Write `<letter>.json` and `<letter>.png` for each letter into `--out`."""
    torch.set_num_threads(1)
    given = settings(Path("params.yaml"))
    sculpting = given.sculpting
    slabs = partial(robot_with, arguments.material, arguments.tool, given.sculpt.scan_pixels)
    robot, end_effector = slabs(arguments.seed)
    window_m = robot.scan().window_m
    members = model_of(arguments.material, arguments.tool, given, arguments.models, window_m)
    reader = LetterClassifier(
        ascii_uppercase, given.sculpt.classifier_examples, given.sculpt.seed, fonts_of_other_families()
    )
    robot.change_tool(end_effector)
    for number, letter in enumerate(arguments.letters):
        record = arguments.out / f"{number}_{letter}.json"
        if record.exists():
            if arguments.one_slab:
                _again(robot, end_effector, json.loads(record.read_text(encoding="utf-8"))["actions"], given)
            continue
        if not arguments.one_slab:
            robot, _ = slabs(100 * arguments.seed + number)
        height, _ = seen_m(robot.scan())
        soften_px = sculpting.edge_blur_m * height.shape[1] / robot.area_m[0]
        relief = relief_of(
            f"letter:{letter}", (height.shape[0], height.shape[1]), sculpting.side_share, soften_px=soften_px
        )
        depth_m = ONE_SLAB_DEPTH_M[number] if arguments.one_slab else DEPTH_M
        fit = fit_goal(relief, height, replace(sculpting.fit, depth_m=depth_m, rising_share=arguments.rising_share))
        made = sculpt(
            robot, end_effector, arguments.material, goal_m=fit.height_m, members=members, grid=given.grid,
            config=sculpting.planner, execution=sculpting.execution, count=arguments.actions,
            session=Session("alphabet", robot.clock_s), item=number, log=_unheard,
        )  # fmt: skip
        objective = ClayObjective(fit.height_m, window_m, sculpting.planner.weights)
        result: dict[str, Any] = goal_errors(objective, made.heights_m, made.first.predicted_m[-1])
        result |= {
            "read": classify_sculpture(reader, made.heights_m[-1], fit.height_m, border=sculpting.fit.border_share),
            "before": reader.classify(made.heights_m[0], sculpting.fit.border_share).letter,
            "letter": letter, "tool": arguments.tool, "seed": arguments.seed, "reach_m": depth_m,
            "actions": made.actions.tolist(), "stopped": made.stopped,
        }  # fmt: skip
        pair = np.hstack([photograph(each, window_m, 2) for each in (fit.height_m, made.heights_m[-1])])
        arguments.out.mkdir(parents=True, exist_ok=True)
        write_png(arguments.out / f"{number}_{letter}.png", pair)
        atomic_write(record, (json.dumps(result, indent=1) + "\n").encode())
        removed = (f"{result[name]['removed']:.0%}" for name in ("error_3d_mm2", "visual_error"))
        print(letter, len(made.actions), *removed, result["read"], f"{time.process_time():.0f} s", flush=True)


def fonts_of_other_families() -> list[Path]:
    """Fonts that Matplotlib brings, without that of the goals."""
    folder = Path(matplotlib.get_data_path()) / "fonts/ttf"
    return [folder / name for name in _FONTS]


def _again(robot: SculptingRobot, end_effector: EndEffector, actions: list[list[float]], given: Settings) -> None:
    """Repeat recorded actions. The studio is deterministic, so that the clay is the same as after the recording."""
    robot.scan()
    scan = robot.scan()
    for action in actions:
        scan = execute_push(
            robot, end_effector, np.array(action), before=scan, speed_m_s=end_effector.speed_m_s,
            dwell_s=given.sculpting.execution.dwell_s, retract_speed_m_s=given.sculpting.execution.retract_speed_m_s,
        ).after  # fmt: skip


def _unheard(_name: str, _value: float, _step: int) -> None:
    """Curves are in the record."""


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="alphabet", description=__doc__)
    parser.add_argument("--material", required=True)
    parser.add_argument("--tool", default="ball")
    parser.add_argument("--rising-share", type=float, required=True, help="share of the displaced volume that rises")
    parser.add_argument("--actions", type=int, default=80, help="at most, of a letter")
    parser.add_argument("--one-slab", action="store_true", help="never smooth the slab: six letters at most")
    parser.add_argument("--models", required=True, type=Path, help="folder of push models; missing ones are trained")
    parser.add_argument("--letters", default=ascii_uppercase)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", required=True, type=Path)
    main(parser.parse_args())

"""What the report reads: one tool's strokes, models and scores; one painting's pictures, plans and metrics."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import read_image
from pentimento.contracts.plan import Plan, read_plan
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.dynamics.strokes.evaluation import StrokeScores
from pentimento.dynamics.strokes.samples import StrokeSamples, load_samples
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters, read_parameters

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]


@dataclass(frozen=True)
class StrokePictures:
    """How measured strokes are shown."""

    shown: int
    """Held-out strokes of each tool, from the best foretold through the median to the worst."""
    path_points: int
    """Points of a path when it is foretold."""
    pixels_per_m: float
    """Photographs finer than this are averaged down to about it."""
    margin_m: float
    """Windows are trimmed to this much around the commanded path."""

    def __post_init__(self) -> None:
        if self.shown < 1:
            raise ValueError(f"shown is {self.shown}; show at least one stroke.")
        at_least(self, 2, "path_points")
        above_zero(self, "pixels_per_m", "margin_m")


@dataclass(frozen=True, eq=False)
class ToolInputs:
    """One tool: strokes that its model has not seen, the model and the trivial one, and their scores."""

    name: str
    held_out: StrokeSamples
    model: Traj2StrokeParameters
    polyline: Traj2StrokeParameters
    """The constant-width pen of least MSE on the training strokes."""
    crisp: Traj2StrokeParameters
    """The one of largest IoU."""
    scores: dict[str, dict[str, StrokeScores]]
    """[`held_out` or `training`][`model`, `polyline` or `blank`]."""
    counts: dict[str, int]
    """Rows: `training`, `held_out`, `quarantined`."""
    epochs: list[float]
    weighted_l1: list[float]


@dataclass(frozen=True, eq=False)
class PaintingInputs:
    """One setting: what was to be painted, what was foretold, what came of it. Pictures are sRGB [H, W, 3]."""

    setting: str
    photograph: Image
    target: Image
    plan: Image
    polyline: Image
    """What the trivial model foretells of the same plan."""
    without: Image
    with_replanning: Image
    frames: list[Image]
    """The canvas before the first stroke and after every batch, with replanning."""
    made: list[float]
    """Strokes made when each entry of the two deviations was measured."""
    deviation_with: list[float]
    deviation_without: list[float]
    iterations: list[float]
    objective: list[float]
    palette_srgb: FloatArray
    executed: Plan
    plan_svg: bytes
    error: dict[str, float]
    """Of `blank`, `plan`, `without_replanning`, `with_replanning` against the target."""
    lowered_by: float
    """Share by which replanning lowers the final error; negative where it raises it."""
    pixel_mse: dict[str, float]
    sim2real_mse: dict[str, float]
    """Of `model`, `polyline`, `blank` against the painting without replanning."""
    sim2real_factor: float


def read_tool(name: str, strokes: Path, weights: Path, config: StrokePictures) -> ToolInputs:
    """Read a tool's table of strokes and the folder of its trained model.

    Raises:
        ContractError: a file is missing or does not hold what it should.
    """
    table = read_table(strokes, CONTRACT).table
    samples = load_samples(table, config.path_points, config.pixels_per_m, config.margin_m)
    apart = torch.tensor(_json(weights / "held_out_actions.json"), dtype=torch.int64)
    held_out = samples.pick(torch.isin(samples.action, apart))
    if len(held_out.path) == 0:
        raise ContractError(
            f"None of the actions in {weights / 'held_out_actions.json'} is in {strokes}; "
            "train the model on these strokes again."
        )
    metrics, curve = _json(weights / "metrics.json"), _json(weights / "curve.json")
    try:
        return ToolInputs(
            name=name,
            held_out=held_out,
            model=read_parameters(weights / "parameters.json"),
            polyline=read_parameters(weights / "polyline.json"),
            crisp=read_parameters(weights / "polyline_for_iou.json"),
            scores={
                part: {model: StrokeScores(**metrics[part][model]) for model in ("model", "polyline", "blank")}
                for part in ("held_out", "training")
            },
            counts={part: metrics["strokes"][part] for part in ("training", "held_out", "quarantined")},
            epochs=curve["epoch"],
            weighted_l1=curve["weighted_l1"],
        )
    except (KeyError, TypeError) as error:
        raise _incomplete(weights, error, "train_stroke_dynamics") from error


def read_painting(setting: str, folder: Path) -> PaintingInputs:
    """Read the folder that the stage `paint` made for a setting.

    Raises:
        ContractError, ImageError: a file is missing or does not hold what it should.
    """
    metrics, curve = _json(folder / "metrics.json"), _json(folder / "curve.json")
    deviation = _json(folder / "deviation.json")
    frames = sorted((folder / "frames").glob("*.png"))
    if not frames:
        raise ContractError(f"{folder / 'frames'} holds no photograph; run the stage paint again.")
    try:
        return PaintingInputs(
            setting=setting,
            photograph=read_image(folder / "photograph.png"),
            target=read_image(folder / "target.png"),
            plan=read_image(folder / "plan.png"),
            polyline=read_image(folder / "polyline.png"),
            without=read_image(folder / "painting_without.png"),
            with_replanning=read_image(folder / "painting_with.png"),
            frames=[read_image(frame) for frame in frames],
            made=deviation["strokes"],
            deviation_with=deviation["with"],
            deviation_without=deviation["without"],
            iterations=curve["iteration"],
            objective=curve["objective"],
            palette_srgb=np.asarray(_json(folder / "palette.json"), dtype=np.float64).reshape(-1, 3),
            executed=read_plan(folder / "executed_with.jsonl"),
            plan_svg=_bytes(folder / "plan.svg"),
            error={part: metrics["error"][part] for part in ("blank", "plan", "without_replanning", "with_replanning")},
            lowered_by=metrics["replanning_lowers_error_by"],
            pixel_mse={part: metrics["pixel_mse"][part] for part in ("without_replanning", "with_replanning")},
            sim2real_mse={part: metrics["sim2real_mse"][part] for part in ("model", "polyline", "blank")},
            sim2real_factor=metrics["sim2real_factor"],
        )
    except (KeyError, TypeError) as error:
        raise _incomplete(folder, error, "paint") from error


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ContractError(
            f"{path} cannot be read ({error.strerror}); run `make repro`, which makes what is missing."
        ) from error


def _json(path: Path) -> Any:
    try:
        return json.loads(_bytes(path))
    except ValueError as error:
        raise ContractError(f"{path} is not JSON ({error}); remove its folder and run `make repro`.") from error


def _incomplete(folder: Path, error: Exception, stage: str) -> ContractError:
    return ContractError(f"The results in {folder} lack an entry ({error}); run the stage {stage} again.")

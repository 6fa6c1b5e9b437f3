"""Drawings of named things in every writer's style, in which both the thing and the writer should be recognised
(thesis Figure 5.6).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import CameraCalibration, calibrate_camera
from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear, to_float, to_uint8
from pentimento.contracts.errors import ConfigError
from pentimento.contracts.markers import markers_around
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.control.guard import GuardedRobot
from pentimento.control.painter import as_linear, observe
from pentimento.control.safety import envelope_for
from pentimento.copainting.drawings.scenes import WHITE, DrawnScene, Placed, render_scene
from pentimento.copainting.drawings.sources import vocabulary
from pentimento.handwriting.drawing import TorchPathBrush, draw_shapes
from pentimento.handwriting.evaluation import StrokeClassifier
from pentimento.planning.strokes.config import ShapedPlanConfig, no_log
from pentimento.planning.strokes.scene import Meaning, scene_with
from pentimento.planning.strokes.shapes import Shapes
from pentimento.robots.driver import Robot
from pentimento.robots.tools import Tool
from pentimento.robots.virtual import virtual_robot
from pentimento.semantics.encoder import Encoder, as_images
from pentimento.semantics.scores import object_scores
from pentimento.semantics.style import style_of

FloatArray = NDArray[np.float64]
Light = NDArray[np.float32]
Picture = NDArray[np.uint8]

_SIZE: Final = 0.875
"""Of a thing, in sides of the sheet."""
_SHOWN_PX: Final = 240
"""Side of a drawing that the judge sees, and of a cell of the contact sheet."""
_STROKES_SHOWN: Final = 6
"""Demonstrations of each writer at the top of the contact sheet."""
_INK: Final = (40, 40, 40)  # of demonstrations, sRGB
_FINE: Final = 4
"""Bits of the fraction of a pixel in OpenCV's coordinates."""


@dataclass(frozen=True)
class SubjectSetting:
    """Several things, each drawn in every writer's style with one tool."""

    tool: str
    """A tool with its own ink draws OpenMoji's lines of a thing, one with paints OpenMoji's picture."""
    world: str
    """The studio's."""
    side_m: float
    """Of the square sheet. Strokes keep their writer's size, so that a larger sheet shows more of a thing."""
    subjects: int
    """Number of things."""
    ink_length_m: float
    """Approximate length of line in each drawing."""
    replan_every: int
    """Strokes between two photographs, each of which replans the rest."""
    planner: ShapedPlanConfig

    def __post_init__(self) -> None:
        above_zero(self, "side_m", "ink_length_m")
        at_least(self, 1, "subjects", "replan_every")

    @property
    def canvas_m(self) -> tuple[float, float]:
        return self.side_m, self.side_m


@dataclass(frozen=True, eq=False)
class DrawnSubject:
    """A thing, drawn in one kind of strokes."""

    strokes: int
    measured_m: list[FloatArray]
    """[N, 2] of each stroke: the path of the tip as the robot measured it."""
    photo: Picture
    """The finished sheet, sRGB [240, 240, 3]."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Things, each drawn in several kinds of strokes."""

    targets: dict[str, Picture]
    """By thing, sRGB [240, 240, 3]."""
    blank: Picture
    """The sheet, of the same size."""
    targets_named_right: float
    """Share of the whole vocabulary whose target the judge names right."""
    drawn: dict[str, dict[str, DrawnSubject]]
    """By kind of strokes (a writer, or a baseline), then by thing."""


def draw_grid(
    setting: SubjectSetting, kinds: Mapping[str, Shapes], *, brush: TorchPathBrush, meaning: Meaning, judge: Encoder,
    seed: int, log: Callable[[str], None],
) -> Grid:  # fmt: skip
    """Choose the things and draw each in each kind of strokes, in the studio.

    Args:
        meaning: what guides the plans.
        judge: names the targets; only things that it names right are drawn.
        seed: of the choice of things and of the studio.
        log: called after each drawing, with what was drawn.

    Raises:
        ConfigError: the judge names fewer things right than the setting asks for.
    """
    with_ink = brush.tool.color_srgb is not None
    robot, calibration = _before_a_blank_sheet(setting, brush.tool, seed)
    blank = as_linear(observe(robot, calibration, setting.planner.pixels_per_m))
    subjects, known = choose_subjects(setting.subjects, blank, judge, with_ink=with_ink, seed=seed)
    targets = {name: subject_on(blank, name, with_ink=with_ink) for name in subjects}
    drawn: dict[str, dict[str, DrawnSubject]] = {}
    for kind, shapes in kinds.items():
        drawn[kind] = {}
        for name, target in targets.items():
            drawn[kind][name] = _draw(setting, target, shapes, brush=brush, meaning=meaning, studio_seed=seed)
            log(f"{name} in {kind}")
    return Grid({name: shown(target) for name, target in targets.items()}, shown(blank), known, drawn)


def _draw(
    setting: SubjectSetting, target: Light, shapes: Shapes, *, brush: TorchPathBrush, meaning: Meaning, studio_seed: int
) -> DrawnSubject:
    """Plan a target [S, S, 3] (linear light), and draw it."""
    robot, calibration = _before_a_blank_sheet(setting, brush.tool, studio_seed)
    scene = scene_with(brush, brush.tool, setting.canvas_m, target, style_of(setting.planner), meaning)
    drawing = draw_shapes(
        robot, calibration, scene, shapes=shapes, ink_m=setting.ink_length_m, replan_every=setting.replan_every,
        config=setting.planner, log=no_log,
    )  # fmt: skip
    photo = observe(robot, calibration, _SHOWN_PX / setting.side_m)
    return DrawnSubject(len(drawing.executed), drawing.measured_m, photo)


def _before_a_blank_sheet(setting: SubjectSetting, tool: Tool, studio_seed: int) -> tuple[Robot, CameraCalibration]:
    studio = virtual_robot(setting.world, setting.canvas_m, studio_seed)
    robot = GuardedRobot(studio, envelope_for(tool, setting.canvas_m))
    return robot, calibrate_camera(robot.photo(), markers_around(setting.canvas_m))


def choose_subjects(count: int, blank: Light, judge: Encoder, *, with_ink: bool, seed: int) -> tuple[list[str], float]:
    """The first things of the vocabulary, in a random order, whose own target the judge names right.

    No drawing in anybody's style takes part in the choice.

    Args:
        blank: the sheet, linear light [S, S, 3].

    Returns:
        The things, and the share of all targets that the judge names right.

    Raises:
        ConfigError: the judge names fewer things right.
    """
    order = [str(name) for name in np.random.default_rng([seed, 31]).permutation(list(vocabulary()))]
    targets = [shown(subject_on(blank, name, with_ink=with_ink)) for name in order]
    right = [name for name, seen in zip(order, name_pictures(judge, targets), strict=True) if name == seen]
    if len(right) < count:
        raise ConfigError(
            f"The judge names {len(right)} of {len(order)} things right and {count} subjects are asked for; lower "
            "`subjects` in draw_subjects_in_hands, or use a judge that knows OpenMoji's drawings."
        )
    return right[:count], len(right) / len(order)


def subject_on(sheet: Light, name: str, *, with_ink: bool) -> Light:
    """The target: a thing of the vocabulary on a sheet [S, S, 3], linear light both."""
    thing = Placed(name, "openmoji", x=0.5, y=0.5, size=_SIZE, turn_rad=0.0, mirrored=False)
    scene = DrawnScene("alone", (thing,), (0,), ground_y=None, sheet_srgb=WHITE, line=0.0)
    drawn = render_scene(scene, {0}, "marker" if with_ink else "colour", side_px=len(sheet))
    light = srgb_to_linear(to_float(drawn.image)).astype(np.float32)
    return np.minimum(light, sheet) if with_ink else np.where(drawn.regions[..., None] > 0, light, sheet)


def shown(light: Light) -> Picture:
    """Linear light [S, S, 3] as sRGB [240, 240, 3]."""
    method = cv2.INTER_AREA if len(light) > _SHOWN_PX else cv2.INTER_LINEAR
    resized = cv2.resize(light, (_SHOWN_PX, _SHOWN_PX), interpolation=method)
    return to_uint8(linear_to_srgb(np.clip(resized, 0.0, 1.0)))


def name_pictures(judge: Encoder, pictures: Sequence[Picture]) -> list[str]:
    """The thing of the whole vocabulary that the judge sees in each picture, uint8 [H, W, 3], all of one size."""
    names = tuple(vocabulary())
    return [names[index] for index in object_scores(judge, as_images(pictures), names).argmax(1).tolist()]


def recognition(grid: Grid, judge: Encoder, who: StrokeClassifier) -> dict[str, Any]:
    """What the judge sees in each drawing, and to which writer the classifier attributes its strokes."""
    subjects = list(grid.targets)
    pictures = {kind: [each[name].photo for name in subjects] for kind, each in grid.drawn.items()}
    pictures |= {"target": list(grid.targets.values()), "blank": [grid.blank] * len(subjects)}
    named = {kind: name_pictures(judge, of_kind) for kind, of_kind in pictures.items()}
    right = {kind: float(np.mean(np.array(names) == subjects)) for kind, names in named.items()}
    # [things, writers] of each kind of strokes
    shares = {kind: np.stack([who.shares(each[s].measured_m) for s in subjects]) for kind, each in grid.drawn.items()}
    majority = {kind: [who.hands[k] for k in of_kind.argmax(1)] for kind, of_kind in shares.items()}
    return {
        "hands": list(who.hands),
        "subjects": subjects,
        "named": named,
        "named_right": right,
        "subjects_named_right": float(np.mean([right[hand] for hand in who.hands])),
        "targets_named_right": grid.targets_named_right,
        "strokes_of": {kind: of_kind.mean(0) for kind, of_kind in shares.items()},
        "own_strokes": float(np.mean([shares[hand][:, k].mean() for k, hand in enumerate(who.hands)])),
        "drawings_of": {kind: dict(Counter(of_kind)) for kind, of_kind in majority.items()},
        "own_drawings": float(np.mean([[found == hand for found in majority[hand]] for hand in who.hands])),
        "chance": {"subject": 1 / len(vocabulary()), "hand": 1 / len(who.hands)},
        "strokes": {kind: float(np.mean([each[s].strokes for s in subjects])) for kind, each in grid.drawn.items()},
    }


def contact_sheet(grid: Grid, demonstrations: Mapping[str, Sequence[FloatArray]], side_m: float) -> Picture:
    """A row for each thing: its target, and its drawing in each kind of strokes; sRGB [H, W, 3].

    The row above them shows strokes [N, 2] (metres) of each writer, at twice the scale of the drawings.
    """
    paper = np.full_like(grid.blank, 255)
    top = [paper, *(_strokes(demonstrations.get(kind, ()), paper, side_m / 2) for kind in grid.drawn)]
    rows = [[target, *(each[name].photo for each in grid.drawn.values())] for name, target in grid.targets.items()]
    return np.vstack([np.hstack(row) for row in (top, *rows)])


def _strokes(paths_m: Sequence[FloatArray], paper: Picture, side_m: float) -> Picture:
    """The first six paths in rows of two."""
    cell, scale = paper.copy(), _SHOWN_PX / side_m
    for number, path in enumerate(paths_m[:_STROKES_SHOWN]):
        middle = (np.array([number % 2, number // 2]) + 0.5) * _SHOWN_PX / np.array([2, 3])
        places = (path - (path.min(0) + path.max(0)) / 2) * [scale, -scale] + middle
        points = [np.rint(places * 2**_FINE).astype(np.int32)]
        cv2.polylines(cell, points, False, _INK, 2, cv2.LINE_AA, _FINE)
    return cell

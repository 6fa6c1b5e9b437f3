# %% [markdown]
# # Paint together
#
# A simulated person draws a house and asks for a tree. The robot photographs the sheet, generates a goal image with a
# tree where there is room, plans strokes for it, and draws them. Then the person asks for a star.

# %%
from pathlib import Path

import cv2
import numpy as np
import torch

from pentimento.control.guard import GuardedRobot
from pentimento.control.painter import as_linear
from pentimento.control.safety import envelope_for
from pentimento.copainting.evaluation.codraw import Codrawing, Story, codraw, film_strip
from pentimento.copainting.evaluation.goal_plans import Medium, PaintContext, as_picture
from pentimento.copainting.evaluation.methods import complete_requests
from pentimento.copainting.evaluation.scoring import surviving_ink
from pentimento.copainting.goal.planner import SeededSampling, load_goal_planner
from pentimento.copainting.sheets import side_by_side
from pentimento.deploy.words import taught_vocabulary
from pentimento.dynamics.strokes.evaluation import constant_width
from pentimento.dynamics.strokes.extended import base_model
from pentimento.planning.strokes.config import PRINT_ALONE, ExecutionNoise, LearningRates, PlannerConfig
from pentimento.planning.strokes.palette import PaletteChoice
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import virtual_robot

torch.set_num_threads(1)
SIDE_M, SIDE_PX = 0.08, 128

# %% [markdown]
# ## The goal planner
#
# The goal planner turns a picture of the canvas and words into a goal image. The one in `base/weights` was trained on
# drawings of 245 things.

# %%
planner = load_goal_planner(Path("base/weights/goal"))
vocabulary = taught_vocabulary("named")
sampling = SeededSampling(steps=6, image_guidance=1.0, text_guidance=2.0, seed=3)


def goal_for(photo, words):
    """The goal for a photograph of the sheet and a request."""
    goals = complete_requests(
        planner,
        photo[None],
        [words],
        sampling,
        medium="with a marker",
        has_ink=True,
        vocabulary=vocabulary,
        largest=0.5,
    )
    return goals[0]


print(f"{len(vocabulary.nouns)} things, such as {', '.join(list(vocabulary.nouns)[:5])}")

# %% [markdown]
# ## The stroke planner
#
# The robot draws with a marker on a sheet of 8 × 8 cm; the planner optimises strokes by gradient. The stroke model is
# the simplest one, a line of constant width; a trained one ([a new brush](2_new_brush.md)) draws closer to the goal.

# %%
strokes = PlannerConfig(
    initialisation="lines",
    candidates=8,
    rounds=1,
    sizes=(0.4, 0.1),
    iterations_per_round=8,
    iterations_free=30,
    iterations_palette=0,
    iterations_replan=5,
    replan_rate=0.3,
    relocate_every=10,
    relocate_share=0.2,
    min_gain_per_stroke=2e-5,
    palette=PaletteChoice("ink", None, None, None),
    sweeps=1,
    path_points=12,
    pixels_per_m=1600.0,
    edge_m=0.002,
    distances_px=(2, 5),
    objectives=PRINT_ALONE,
    execution_noise=ExecutionNoise(0.0, 0.0),
    learning_rates=LearningRates(8e-4, 0.04, 8e-4, 5e-4, 2e-5, 0.0),
    seed=0,
)
tool = load_tool("marker")
context = PaintContext(
    Medium("marker", SIDE_M, "with a marker", None, strokes),
    tool,
    base_model(constant_width(tool.nominal_width_m / 2, 0.9)),
)
robot = GuardedRobot(virtual_robot("marker", (SIDE_M, SIDE_M), 3), envelope_for(tool, (SIDE_M, SIDE_M)))

# %% [markdown]
# ## Two turns
#
# After every fifteen strokes the robot photographs the sheet and replans the remaining strokes.

# %%
house = np.full((SIDE_PX, SIDE_PX, 3), 255, np.uint8)
for corners in (
    [(12, 75), (32, 55), (52, 75)],
    [(14, 75), (14, 110), (50, 110), (50, 75)],
    [(28, 110), (28, 92), (37, 92), (37, 110)],
):
    cv2.polylines(house, [np.array(corners)], False, (0, 0, 0), 2, cv2.LINE_AA)
story = Story("house", ("a tree", "a star"), (house, None), SIDE_PX, None)
rules = Codrawing(
    stories=1, person_strokes=14, robot_strokes=40, tremor_m=0.0003, replan_every=15, wishes=2, largest=0.5
)
turns = codraw(robot, context, story, goal_for, config=rules, seed=3)
for turn in turns:
    print(f"{turn.prompt}: {turn.strokes[0]} strokes by the person, {turn.strokes[1]} by the robot")


def seen(photo):
    return as_picture(as_linear(photo), SIDE_PX)[None]


figure = float(surviving_ink(seen(turns[0].started), seen(turns[-1].after))[0])
print(f"Share of the person's ink that is still there: {figure:.2f}")

# %% [markdown]
# Each row of the picture is a turn: the person's drawing, the goal, the planned strokes, and the sheet afterwards.
# The robot draws beside the house and not over it. Its lines are lighter than planned, because the stroke model was
# not trained.
#
# To draw together with it on a page in your browser, run `make repro` once and then
# `pentimento studio models/bundle`: [painting beside a person](../running.md).

# %%
picture = side_by_side(film_strip(turns), [turn.prompt for turn in turns], (200, 200))

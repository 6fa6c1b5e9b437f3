# %% [markdown]
# # Sculpt
#
# A robot presses a letter into foam with a ball. It first trains a model of pushes on a few of them, and then plans
# pushes with the model.

# %%
import numpy as np
import pyarrow as pa
import torch

from pentimento.collection.pushes import PushCollectionConfig, collect_pushes
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.schema import arrow_schema
from pentimento.control.execute import Session
from pentimento.control.push_safety import GuardedSculptingRobot, push_envelope_for
from pentimento.control.sculpting_settings import Execution
from pentimento.control.sculptor import sculpt, seen_m
from pentimento.dynamics.pushes.evaluation import predict, unchanged
from pentimento.dynamics.pushes.measured import load_pushes
from pentimento.dynamics.pushes.pose import in_pose
from pentimento.dynamics.pushes.push_model import planned_members
from pentimento.dynamics.pushes.training import TrainingConfig, crop_for, split_by_action, train
from pentimento.goals3d.shading import photograph
from pentimento.goals3d.sources import relief_of
from pentimento.planning.objectives import Weights
from pentimento.planning.pushes.config import PushRates, SculptorConfig
from pentimento.planning.pushes.goal import GoalSettings, fit_goal
from pentimento.robots.tools import load_end_effector
from pentimento.robots.virtual import virtual_sculpting_robot

torch.set_num_threads(1)
PIXELS, BALL = 64, load_end_effector("ball")


def foam(seed):
    """A robot of the studio with a new slab, behind its safety envelope."""
    robot = virtual_sculpting_robot("foam", PIXELS, seed)
    return GuardedSculptingRobot(robot, push_envelope_for(BALL, robot.area_m))


# %% [markdown]
# ## Train a model of pushes
#
# Thirty random pushes, each with a scan of the surface before and after. A network predicts the change of the
# heights; it starts from the shape of the tool. Its error on held-out pushes is compared with the baseline "no
# change".

# %%
robot = foam(1)
rows = collect_pushes(
    robot, BALL, "foam",
    PushCollectionConfig(
        pushes=30, repeated=2, times=2, pushes_per_smoothing=(3, 6), revisit_share=0.5, edge_m=0.025,
        scan_pixels=PIXELS, seed=1,
    ),
    lambda name, value, step: None,
)  # fmt: skip
schema = arrow_schema(CONTRACT, include_optional=set(rows[0]))
for name in sorted(rows[0].keys() - set(schema.names)):
    schema = schema.append(pa.field(name, pa.float32()))  # the room's sensors
samples, _ = load_pushes(pa.Table.from_pylist(rows, schema=schema))
config = TrainingConfig(
    pixels_per_m=PIXELS / 0.2, side_px=32, behind_m=0.03, channels=8, members=1, epochs=8, batch=8,
    learning_rate=0.004, visual_weight=1.0, held_out=0.25, seed=0,
)  # fmt: skip
training, held_out = split_by_action(samples, config.held_out, config.seed)
crop = crop_for(samples, config)
model = train(
    in_pose(training, crop), "push", [("foam", "ball")], crop=crop, config=config, log=lambda name, value, step: None
)


def error_mm2(predicted):
    return float(np.square(1e3 * (predicted.numpy() - held_out.after))[held_out.known].mean())


print(f"{len(training.before)} pushes to learn from, {len(held_out.before)} to test on")
print(f"error in height, model:     {error_mm2(predict(model, held_out)):.4f} mm²")
print(f"error in height, no change: {error_mm2(unchanged(held_out)):.4f} mm²")

# %% [markdown]
# ## A goal within reach
#
# A shape, a letter, a mesh or a picture becomes a relief, which is fitted to the slab: as deep as the tool reaches,
# with an unchanged border.

# %%
robot = foam(2)
window_m = np.array([0.0, 0.0, *robot.area_m])
before, _ = seen_m(robot.scan())
relief = relief_of("letter:I", before.shape, 0.6, soften_px=1.5)
fit = GoalSettings(
    volume_weight=1.0, floor_weight=10.0, range_weight=0.01, rising_share=0.25, depth_m=0.0035, border_share=0.1
)
goal = fit_goal(relief, before, fit).height_m

# %% [markdown]
# ## Plan, push, scan
#
# The planner compares pushes at all places, evaluates the best of them with the model, and improves the best one. After
# every two pushes the robot scans the foam and replans.

# %%
planner = SculptorConfig(
    weights=Weights(error_3d=1.0, visual=4.0), disagreement_weight=0.0, horizon=4, screened=12, candidates=8,
    rounds=0, guided_share=0.8, refine="newton", iterations=2, learning_rates=PushRates(0.002, 0.15, 0.003, 0.0006),
    samples=4, elite_share=0.5, min_relative_gain=0.001, edge_m=0.012, seed=0,
)  # fmt: skip
result = sculpt(
    robot, BALL, "foam", goal_m=goal, members=planned_members(model, window_m), grid=(PIXELS, PIXELS), config=planner,
    execution=Execution(replan_every=2, patience=6, dwell_s=0.5, retract_speed_m_s=0.05), count=10,
    session=Session("tutorial", robot.clock_s), item=0, log=lambda name, value, step: None,
)  # fmt: skip
errors = np.square(1e3 * (result.heights_m - goal)).mean((1, 2))
figure = float(1 - errors[-1] / errors[0])
print(f"{len(result.actions)} pushes; {result.stopped}")
print(f"Share of the error in height that is gone: {figure:.2f}")

# %% [markdown]
# The picture shows the foam before, the goal, and the foam after the pushes, lit from the side. Ten pushes of a ball
# make the stem; the serifs need more.
#
# With the bundle of `make repro`, one command sculpts letters, meshes and pictures:
# [sculpting](../running.md#sculpting). With more pushes and a model trained on more of them:
# [sculpting results](../sculpting.md).

# %%
picture = np.hstack([photograph(height, window_m, 3) for height in (before, goal, result.heights_m[-1])])

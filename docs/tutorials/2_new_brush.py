# %% [markdown]
# # A new brush
#
# You have a new brush. The robot makes some strokes with it, and a model learns its behaviour. No real robot is
# needed here: the studio has one, and a brush whose behaviour the model does not know.

# %%
import tempfile
from pathlib import Path

import pyarrow as pa
import torch

from pentimento.collection.collect import collect_strokes
from pentimento.collection.design import CollectionConfig
from pentimento.contracts.colour import to_uint8
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.copainting.sheets import side_by_side
from pentimento.dynamics.strokes.evaluation import fit_polyline, mean_iou, predict_with
from pentimento.dynamics.strokes.samples import load_samples
from pentimento.dynamics.strokes.training import TrainingConfig, split_by_action, train
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import virtual_robot

torch.set_num_threads(1)

# %% [markdown]
# ## The tool file
#
# A tool file has what is on the package or can be measured with a ruler: a width, and the ranges of press and speed.
# It says nothing about the look of a stroke. Its name is that of a brush of the studio, which stands in for yours.

# %%
TOOL = """
name = "round_brush"
medium = "acrylic"
kind = "round"
nominal_width = "6 mm"
press_range = ["0.3 mm", "3.5 mm"]
stroke_length = ["8 mm", "45 mm"]
bend_range = [-0.35, 0.35]
speed = "60 mm/s"
speed_range = ["20 mm/s", "120 mm/s"]
strokes_per_dip = 4
"""
file = Path(tempfile.mkdtemp()) / "my_brush.toml"
file.write_text(TOOL, encoding="utf-8")
tool = load_tool(file)
print(f"{tool.nominal_width_m * 1e3:.0f} mm wide, strokes of up to {tool.stroke_length_m[1] * 1e3:.0f} mm")

# %% [markdown]
# ## Collect strokes
#
# Thirty strokes: 24 different commands, and three that are executed twice. Lengths, bends, presses and speeds are
# random and independent, so that causes of errors can be separated. Every stroke passes a safety envelope that is
# derived from the tool file.

# %%
config = CollectionConfig(
    strokes=30,
    repeated=3,
    times=2,
    crossing_share=0.3,
    path_points=32,
    margin_m=0.012,
    edge_m=0.008,
    pixels_per_m=1000,
    settle_s=(1.0, 60.0),
    palette_srgb=((0.10, 0.12, 0.45), (0.50, 0.08, 0.10)),
    yaw_spread_rad=0.7,
    seed=1,
)
canvas_m = (0.3, 0.2)
robot = GuardedRobot(virtual_robot("round_brush", canvas_m, 1), envelope_for(tool, canvas_m))
rows = collect_strokes(robot, tool, config, lambda name, value, step: None, None)
table = pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT, include_optional=set(rows[0])))
print(f"{table.num_rows} strokes on {len(set(table['surface_id'].to_pylist()))} sheets")

# %% [markdown]
# ## Train a model
#
# Traj2Stroke has seven parameters: the width as a function of press, the scale and offset of the mark, its softness
# and darkness. It is trained on three quarters of the strokes and tested on the rest. The baseline is a line of
# constant width and darkness, fitted to the same strokes.

# %%
training_config = TrainingConfig(
    path_points=32,
    pixels_per_m="auto",
    margin_m="auto",
    epochs=8,
    batch=8,
    learning_rate=0.03,
    ink_weight=2.0,
    held_out=0.25,
    seed=0,
)
samples = load_samples(table, training_config.path_points, "auto", "auto")
training, held_out = split_by_action(samples, training_config.held_out, training_config.seed)
model = train(training, training_config, lambda name, value, step: None).parameters_si()
line = fit_polyline(lambda pen: -mean_iou(predict_with(pen, training), training), tool.nominal_width_m / 2)
predicted = predict_with(model, held_out)
figure = mean_iou(predicted, held_out)
of_line = mean_iou(predict_with(line, held_out), held_out)
print(f"IoU on {len(held_out.path)} held-out strokes: model {figure:.3f}, line {of_line:.3f}")

# %% [markdown]
# The picture shows three held-out strokes: the photograph before, the photograph after, and the prediction. Place and
# width are close; the paint is still too thin after eight epochs on twenty-one strokes.
#
# `pentimento enough` says whether more strokes would help, and `pentimento new tool` adds a brush to the pipeline,
# which then diagnoses it and paints with it: [a new brush, step by step](../new_brush.md).

# %%
some = slice(0, 3)
shown = held_out.valid[some, ..., None]  # windows differ in size; the rest is blank
columns = {"before": held_out.before, "after": held_out.after, "predicted": predicted}
picture = side_by_side(
    {name: [to_uint8(each.numpy()) for each in images[some] * shown + (1 - shown)] for name, images in columns.items()},
    ["", "", ""],
    (160, 220),
)

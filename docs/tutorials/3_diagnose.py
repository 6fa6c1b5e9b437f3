# %% [markdown]
# # Diagnose a table of your own
#
# You have a table of measurements, a simulator that should predict them, and a gap between the two. You list possible
# causes, and the diagnosis says which of them are present. It works for any simulator: here, a cart that glides along
# a rail.

# %%
import csv
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from pentimento.diagnosis.diagnose import diagnose
from pentimento.diagnosis.problem import Cause, Quantity, Rows
from pentimento.diagnosis.simulator import Parameter, SimulatorProblem
from pentimento.diagnosis.verdict import verdict

TIMES_S = np.linspace(0.1, 1.5, 8)

# %% [markdown]
# ## The table
#
# A row is one push: the initial speed of the cart, the direction, the temperature of the room, and the distance (in
# mm) at eight times. Pushes are random, and some are repeated, to measure the noise.
#
# This cell stands in for your recording. It has a hidden effect: the grease of the bearings is thinner when it is
# warm.

# %%
rng = np.random.default_rng(4)
action = np.concatenate([np.arange(70), np.repeat(np.arange(70, 84), 2)])
speed = rng.uniform(0.3, 1.2, 84)[action]
direction = rng.choice([-1.0, 1.0], 84)[action]
order = rng.permutation(len(action))
temperature = 20 + 6 * np.sin(np.arange(len(action)) / 9) + rng.normal(0, 0.5, len(action))
drag = (1.1 / (1 + 0.025 * (temperature - 20)))[:, None]
start = speed[order][:, None]
glided = start / drag * (1 - np.exp(-drag * TIMES_S)) * 1e3 + rng.normal(0, 1.5, (len(action), len(TIMES_S)))
file = Path(tempfile.mkdtemp()) / "cart.csv"
with file.open("w", newline="", encoding="utf-8") as out:
    table = csv.writer(out)
    table.writerow(["action", "speed", "direction", "temperature", *(f"x{n}" for n in range(len(TIMES_S)))])
    table.writerows(np.column_stack([action[order], speed[order], direction[order], temperature, glided]))
print(file.read_text(encoding="utf-8").splitlines()[0], f"and {len(action)} rows")

# %% [markdown]
# ## The simulator, and possible causes
#
# The simulator is one function from the values of its parameters to the readings. *Nuisances* are parameters whose
# values are only roughly known. A *cause* has no effect while its quantity is 0; its typical size sets the scale, and
# its covariates are the columns that its effect depends on.

# %%
read = np.genfromtxt(file, delimiter=",", names=True)
column = {name: read[name] for name in ("speed", "direction", "temperature")}
measured_mm = np.column_stack([read[f"x{n}"] for n in range(len(TIMES_S))])

NUISANCES = (Parameter("log_drag", 0.0, 0.1), Parameter("log_speed", 0.0, 0.05), Parameter("offset_mm", 0.0, 2.0))
CAUSES = (
    Cause("warm_grease", (Quantity("drag_per_k", "1/K", 0.01),), ("temperature",)),
    Cause("tilted_rail", (Quantity("slope", "m/m", 0.005),), ("direction",)),
    Cause("dry_friction", (Quantity("friction_m_s2", "m/s²", 0.05, signed=False),), ("speed",)),
    Cause("late_clock", (Quantity("delay_s", "s", 0.02),), ("speed",)),
)


def predict(rows, value):
    """Readings [rows, times] in mm, for the value of every parameter and quantity."""
    warm = column["temperature"][rows, None] - 20
    drag = np.exp(value["log_drag"] - value["drag_per_k"] * warm)
    pull = 9.81 * value["slope"] * column["direction"][rows, None] - value["friction_m_s2"]
    since = TIMES_S - value["delay_s"]
    fading = (1 - np.exp(-drag * since)) / drag
    start = column["speed"][rows, None] * np.exp(value["log_speed"])
    return (start * fading + pull * (since - fading) / drag) * 1e3 + value["offset_mm"]


number = np.arange(len(read))
problem = SimulatorProblem(
    predict,
    measured_mm,
    NUISANCES,
    {cause.name: cause for cause in CAUSES},
    Rows(read["action"].astype(int), read["action"].astype(int), number, column),
    kind="pushes of the cart",
    unit="mm²",
    seed=0,
    index=number,
)

# %% [markdown]
# ## The verdict
#
# 60 % of the pushes propose causes and 20 % confirm them. The other 20 %, which no decision uses, measure the gain. A
# cause is *established* if its probability is at least .95.

# %%
found = diagnose(problem, seed=0, log=lambda line: None)
content = verdict(found)
print(content["text"])
figure = content["gap_closed"]["test"]
print(f"Fraction of the gap closed: {figure:.3f}")

# %% [markdown]
# The hidden cause is named, and its quantity has a unit and a standard error. The *structured residual* is the next
# hint: in the simulator the drag falls exponentially with the temperature, in the recording as 1 / (1 + 0.025 (T −
# 20)). The small difference remains, and the diagnosis names the parameter and the column that it depends on.
#
# The picture, left: the residual of each push (measured minus predicted distance at the last time) grows with the
# temperature. Right: with the cause in the simulator, only noise remains.
#
# With this function in a module of yours, `pentimento diagnose` does the same from a terminal. The evidence, its
# weights, and an example with a robot arm: [diagnose your own simulator](../diagnose_your_simulator.md).

# %%
sketch, axes = plt.subplots(1, 2, figsize=(7, 3), sharey=True, layout="constrained", dpi=80)
for axis, causes in zip(axes, ((), ("warm_grease",)), strict=True):
    fitted = problem.fit(causes)
    axis.plot(column["temperature"], (measured_mm - predict(number, problem.values(fitted)))[:, -1], ".")
    axis.set(xlabel="temperature (°C)", title=", ".join(causes) or "no cause")
axes[0].set_ylabel("farther than predicted (mm)")
sketch.canvas.draw()
picture = np.asarray(sketch.canvas.buffer_rgba())[..., :3].copy()
plt.close(sketch)

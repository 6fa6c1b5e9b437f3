"""Test support: a push model of foam for a bundle, without PyTorch, as hand-written graphs.

A push leaves one round dent where the tool, which sinks on its way, has pressed most: two thirds along.
"""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np

from pentimento.bundle.manifest import ClayFacts
from pentimento.bundle.reader import MANIFEST
from pentimento.contracts.codec import to_plain
from pentimento.contracts.frames import pixel_to_canvas
from pentimento.control.sculpting_settings import Execution, SculptingSettings
from pentimento.planning.pushes.goal import GoalSettings
from pentimento.planning.pushes.places import PlaceModel, place_model_bytes
from pentimento.robots.tools import ball_m3
from tests.bundle.tiny_bundle import add_graphs, change, numbers, relist
from tests.planning.pushes.settings import CONFIG

PIXELS, SIDE_M = 48, 0.2
FACTS = ClayFacts("ball", "push", (0.0, 0.0, SIDE_M, SIDE_M), (PIXELS, PIXELS), 0.03, 0.01, 1, None)
SETTINGS = SculptingSettings(
    actions=60, side_share=0.7, edge_blur_m=0.0028,
    fit=GoalSettings(
        volume_weight=1.0, floor_weight=10.0, range_weight=0.01, rising_share=0.25, depth_m=0.0035, border_share=0.1
    ),
    planner=replace(CONFIG, edge_m=0.03, horizon=2, candidates=8, iterations=1),
    execution=Execution(replan_every=4, patience=12, dwell_s=0.5, retract_speed_m_s=0.05),
)  # fmt: skip

_WIDE_M = 0.007
_PLACES = pixel_to_canvas(np.arange(PIXELS)[:, None].repeat(2, 1), np.array(FACTS.window_m), PIXELS / SIDE_M)
_CONSTANTS = f"""
    float[1,1,{PIXELS}] columns = {{{numbers(_PLACES[:, 0])}}}, float[1,{PIXELS},1] rows = {{{numbers(_PLACES[:, 1])}}},
    float share = {{{2 / 3}}}, float variance = {{{_WIDE_M**2}}}, float half = {{-0.5}}
"""
_DENTS = """
    one = Constant <value_ints = [1]> ()
    x, y, theta, length, depth = Split <axis = 1, num_outputs = 5> (actions)
    cos = Cos (theta)
    sin = Sin (theta)
    ahead = Mul (length, share)
    forth_x = Mul (ahead, cos)
    forth_y = Mul (ahead, sin)
    middle_x = Add (x, forth_x)
    middle_y = Add (y, forth_y)
    at_x = Unsqueeze (middle_x, one)
    at_y = Unsqueeze (middle_y, one)
    deep = Unsqueeze (depth, one)
    from_x = Sub (columns, at_x)
    from_y = Sub (rows, at_y)
    square_x = Mul (from_x, from_x)
    square_y = Mul (from_y, from_y)
    square = Add (square_x, square_y)
    widths = Div (square, variance)
    exponent = Mul (widths, half)
    round = Exp (exponent)
    dents = Mul (round, deep)
"""
_HEIGHT = f"float[{PIXELS},{PIXELS}]"

AFTER = f"""
({_HEIGHT} height_m, float[pushes,5] actions) => (float[pushes,{PIXELS},{PIXELS}] after_m)
<{_CONSTANTS}>
{{
    {_DENTS}
    after_m = Sub (height_m, dents)
}}"""
PULL = f"""
({_HEIGHT} height_m, float[5] action, {_HEIGHT} of_after) => ({_HEIGHT} to_height, float[5] to_action)
<{_CONSTANTS}>
{{
    first = Constant <value_ints = [0]> ()
    actions = Unsqueeze (action, first)
    {_DENTS}
    to_height = Identity (of_after)
    of_dents = Neg (of_after)
    by_depth = Mul (of_dents, round)
    by_place = Mul (of_dents, dents)
    of_x = Mul (by_place, from_x)
    of_y = Mul (by_place, from_y)
    along_x = ReduceSum <keepdims = 0> (of_x)
    along_y = ReduceSum <keepdims = 0> (of_y)
    to_x = Div (along_x, variance)
    to_y = Div (along_y, variance)
    to_depth = ReduceSum <keepdims = 0> (by_depth)
    forth_cos = Mul (to_x, cos)
    forth_sin = Mul (to_y, sin)
    forth = Add (forth_cos, forth_sin)
    to_length = Mul (forth, share)
    turn_cos = Mul (to_y, cos)
    turn_sin = Mul (to_x, sin)
    turn = Sub (turn_cos, turn_sin)
    to_theta = Mul (turn, ahead)
    flat = Constant <value_ints = [-1]> ()
    x_of_5 = Reshape (to_x, flat)
    y_of_5 = Reshape (to_y, flat)
    theta_of_5 = Reshape (to_theta, flat)
    length_of_5 = Reshape (to_length, flat)
    depth_of_5 = Reshape (to_depth, flat)
    to_action = Concat <axis = 0> (x_of_5, y_of_5, theta_of_5, length_of_5, depth_of_5)
}}"""


PLACES = PlaceModel("pellets", 0.7, 0.006, 0.3, 4.0, ball_m3(0.01), (ball_m3(0.006), ball_m3(0.014)), 0.05, 24)


def add_feeder(folder: Path) -> Path:
    """Let pellets of the bundle's foam be placed, too."""
    (folder / "feeders").mkdir()
    feeder = (resources.files("pentimento.robots") / "feeders" / "pellets.toml").read_bytes()
    (folder / "feeders/pellets.toml").write_bytes(feeder)
    (folder / "places").mkdir()
    (folder / "places/clay_foam.json").write_bytes(place_model_bytes(PLACES))
    change(
        folder,
        clays={"clay_foam": to_plain(replace(FACTS, places="places/clay_foam.json"))},
        sculpting={"clay_foam": to_plain(replace(SETTINGS, feeder="pellets"))},
    )
    relist(folder)
    return folder


def add_clay(folder: Path) -> Path:
    """Add the push model to a bundle."""
    add_graphs(folder, {"clay_foam_0_after": AFTER, "clay_foam_0_pull": PULL}, "push_foam")
    (folder / "end_effectors").mkdir()
    ball = (resources.files("pentimento.robots") / "end_effectors" / "ball.toml").read_bytes()
    (folder / "end_effectors/ball.toml").write_bytes(ball)
    models = json.loads((folder / MANIFEST).read_text())["models"]
    change(
        folder,
        clays={"clay_foam": to_plain(FACTS)},
        sculpting={"clay_foam": to_plain(SETTINGS)},
        models=models | {"push_foam": "2"},
    )
    relist(folder)
    return folder

"""Test support: a bundle that can paint, without PyTorch: a pen and a goal planner as hand-written graphs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from pentimento.bundle.reader import MANIFEST
from pentimento.bundle.vocabulary import Noun, Vocabulary
from pentimento.contracts.codec import to_plain
from pentimento.planning.strokes.latent import write_decoder
from pentimento.robots.strokes import shape_basis
from tests.bundle.small_hands import HAND_POINTS, small_hand
from tests.bundle.tiny_bundle import PLANNER, add_graphs, change, numbers, relist, write_tiny_bundle

POINTS = PLANNER.path_points


_ALONG, _ACROSS = (numbers(basis) for basis in shape_basis(POINTS))
_STROKES = (
    "float[S,2] middle_m, float[S] theta_rad, float[S] length_m, float[S] bend_m, float[S,3] press_m, float[S,3] color"
)
_GEOMETRY = """
    one = Constant <value_ints = [1]> ()
    t = Unsqueeze (theta_rad, one)
    l = Unsqueeze (length_m, one)
    b = Unsqueeze (bend_m, one)
    cos = Cos (t)
    sin = Sin (t)
    a = Mul (l, along)
    c = Mul (b, across)
    ca = Mul (cos, a)
    sc = Mul (sin, c)
    sa = Mul (sin, a)
    cc = Mul (cos, c)
    dx = Sub (ca, sc)
    dy = Add (sa, cc)
"""
_BASES = f"float[1,{POINTS}] along = {{{_ALONG}}}, float[1,{POINTS}] across = {{{_ACROSS}}}"

MARKS = f"""
({_STROKES}) => (float[S,{POINTS},2] points_m, float[S,{POINTS}] radius_m, float[S,{POINTS}] density,
                 float[S,{POINTS}] softness, float[S,3] paint)
<{_BASES}, float zero = {{0}}, float r = {{0.0011}}, float d = {{0.85}}, float s = {{0.4}}>
{{
    {_GEOMETRY}
    two = Constant <value_ints = [2]> ()
    offsets_x = Unsqueeze (dx, two)
    offsets_y = Unsqueeze (dy, two)
    offsets = Concat <axis = 2> (offsets_x, offsets_y)
    middle = Unsqueeze (middle_m, one)
    points_m = Add (offsets, middle)
    nothing = Mul (dx, zero)
    radius_m = Add (nothing, r)
    density = Add (nothing, d)
    softness = Add (nothing, s)
    paint = Identity (color)
}}"""
PULL = f"""
({_STROKES}, float[S,{POINTS},2] d_points_m, float[S,{POINTS}] d_radius_m, float[S,{POINTS}] d_density,
 float[S,{POINTS}] d_softness, float[S,3] d_paint)
=> (float[S,2] d_middle_m, float[S] d_theta_rad, float[S] d_length_m, float[S] d_bend_m, float[S,3] d_press_m,
    float[S,3] d_color)
<{_BASES}, float zero = {{0}}>
{{
    {_GEOMETRY}
    x = Constant <value_int = 0> ()
    y = Constant <value_int = 1> ()
    gx = Gather <axis = 2> (d_points_m, x)
    gy = Gather <axis = 2> (d_points_m, y)
    d_middle_m = ReduceSum <keepdims = 0> (d_points_m, one)
    turn_y = Mul (gy, dx)
    turn_x = Mul (gx, dy)
    turn = Sub (turn_y, turn_x)
    d_theta_rad = ReduceSum <keepdims = 0> (turn, one)
    forth_x = Mul (gx, cos)
    forth_y = Mul (gy, sin)
    forth = Add (forth_x, forth_y)
    longer = Mul (forth, along)
    d_length_m = ReduceSum <keepdims = 0> (longer, one)
    left_y = Mul (gy, cos)
    left_x = Mul (gx, sin)
    left = Sub (left_y, left_x)
    further = Mul (left, across)
    d_bend_m = ReduceSum <keepdims = 0> (further, one)
    d_press_m = Mul (press_m, zero)
    d_color = Identity (d_paint)
}}"""
# Commanded paths are the lines.
PATH_MARKS = f"""
(float[S,{HAND_POINTS},5] path, float[S,3] color)
=> (float[S,{HAND_POINTS},2] points_m, float[S,{HAND_POINTS}] radius_m, float[S,{HAND_POINTS}] density,
    float[S,{HAND_POINTS}] softness, float[S,3] paint)
<float zero = {{0}}, float r = {{0.0011}}, float d = {{0.85}}, float s = {{0.4}}>
{{
    first = Constant <value_ints = [1]> ()
    end = Constant <value_ints = [3]> ()
    axis = Constant <value_ints = [2]> ()
    points_m = Slice (path, first, end, axis)
    depth = Constant <value_int = 3> ()
    z = Gather <axis = 2> (path, depth)
    nothing = Mul (z, zero)
    radius_m = Add (nothing, r)
    density = Add (nothing, d)
    softness = Add (nothing, s)
    paint = Identity (color)
}}"""
PATH_PULL = f"""
(float[S,{HAND_POINTS},5] path, float[S,3] color, float[S,{HAND_POINTS},2] d_points_m,
 float[S,{HAND_POINTS}] d_radius_m, float[S,{HAND_POINTS}] d_density, float[S,{HAND_POINTS}] d_softness,
 float[S,3] d_paint)
=> (float[S,{HAND_POINTS},5] d_path, float[S,3] d_color)
{{
    around = Constant <value_ints = [0, 0, 1, 0, 0, 2]> ()
    d_path = Pad (d_points_m, around)
    d_color = Identity (d_paint)
}}"""
READ = """(int64[B,8] tokens) => (float[B,8,1] states)
{ last = Constant <value_ints = [2]> ()
  numbers = Cast <to = 1> (tokens)
  states = Unsqueeze (numbers, last) }"""
ENCODE = """(float[B,3,16,16] pictures) => (float[B,4,8,8] latents)
{ colours = AveragePool <kernel_shape = [2, 2], strides = [2, 2]> (pictures)
  channel = Constant <value_ints = [1]> ()
  grey = ReduceMean (colours, channel)
  latents = Concat <axis = 1> (colours, grey) }"""
# A goal as the canvas is, but darker in its upper half.
DENOISE = """(float[B,8,8,8] noisy, int64[1] timestep, float[B,8,1] states) => (float[B,4,8,8] latents)
<float[1,1,8,1] shade = {1, 1, 1, 1, 0, 0, 0, 0}, float scaling = {0.8}>
{ noise, canvas = Split <axis = 1, num_outputs = 2> (noisy)
  darker = Sub (canvas, shade)
  latents = Mul (darker, scaling) }"""
DECODE = """(float[B,4,8,8] latents) => (float[B,3,16,16] pictures)
<float[4] scales = {1, 1, 2, 2}>
{ start = Constant <value_ints = [0]> ()
  end = Constant <value_ints = [3]> ()
  channel = Constant <value_ints = [1]> ()
  colours = Slice (latents, start, end, channel)
  pictures = Resize <mode = "nearest"> (colours, , scales) }"""
_GRAPHS = {
    "pen_marks": MARKS, "pen_pull": PULL, "goal_text": READ, "goal_encode": ENCODE, "goal_denoise": DENOISE,
    "goal_decode": DECODE,
}  # fmt: skip


def small_vocabulary() -> Vocabulary:
    """Cats and dogs."""
    cat = Noun("a cat", "cats", ("cat", "kitten"), ("cats", "kittens"), ("tabby",))
    dog = Noun("a dog", "dogs", ("dog",), ("dogs",), ("poodle",))
    return Vocabulary("written by hand", False, {"cat": cat, "dog": dog})


def write_painting_bundle(
    folder: Path, vocabulary: Vocabulary | None = None, hands: Sequence[str] = ()
) -> Path:  # fmt: skip
    """Write the bundle into a new folder; its goal planner knows all words, or a vocabulary."""
    write_tiny_bundle(folder)
    add_graphs(folder, _GRAPHS, "stroke_marker")
    letters = [f"{letter}</w>" for letter in "abcdefghijklmnopqrstuvwxyz"]
    words = {word: number for number, word in enumerate([*letters, "<|startoftext|>", "<|endoftext|>"])}
    (folder / "words/vocab.json").write_text(json.dumps(words))
    if vocabulary is not None:
        (folder / "words/nouns.json").write_text(json.dumps(to_plain(vocabulary)))
        goal = json.loads((folder / MANIFEST).read_text())["goal"]
        change(folder, goal=goal | {"nouns": "words/nouns.json"})
    if hands:
        add_graphs(folder, {"pen_path_marks": PATH_MARKS, "pen_path_pull": PATH_PULL}, "stroke_marker")
        for hand in hands:
            write_decoder(folder / f"hands/{hand}.npz", small_hand(hand))
        manifest = json.loads((folder / MANIFEST).read_text())
        brush = manifest["brushes"]["pen"] | {"path_points": HAND_POINTS}
        change(
            folder, brushes=manifest["brushes"] | {"pen_path": brush},
            settings={"pen": manifest["settings"]["pen"] | {"path_brush": "pen_path"}},
            hands={hand: {"file": f"hands/{hand}.npz", "synthetic": False} for hand in hands},
        )  # fmt: skip
    relist(folder)
    return folder

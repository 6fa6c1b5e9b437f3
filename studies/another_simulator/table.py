"""The diagnosis of worlds of a second simulator, as a page: `python -m studies.another_simulator.table`.

Simulates each world, diagnoses its table in a separate process, and writes `docs/another_simulator.md`. A world with a
verdict in `data/studies/another_simulator/` is not diagnosed again.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from studies.another_simulator.session import recorded
from studies.another_simulator.world import Effects, World
from studies.blind.one_world import verdict_by_table
from studies.other_worlds import listed, named, rivals, share_closed, verdicts

_RED = (0.60, 0.15, 0.10)
WORLDS = (
    World("pen", "nib", 1),
    World("broad pen", "chisel", 2, pixels_per_m=900),
    World("brush over old paint", "hairs", 3, painted_over=True),
    World("pen, no repeats", "nib", 4, rows=120, repeats=False),
    World("ink runs out", "nib", 5, Effects(ink_depletion=4.0)),
    World("hairs spread", "hairs", 6, Effects(tool_wear=0.3)),
    World("red, thin when fast", "nib", 7, Effects(speed_width=0.18), color_srgb=_RED),
    World("hairs drag", "hairs", 8, Effects(bristle_lag=0.004)),
    World("broad pen, late", "chisel", 9, Effects(latency=0.05)),
    World("play, two sessions", "nib", 10, Effects(backlash=0.0018), sessions=2),
    World("broad pen, too long", "chisel", 11, Effects(path_scale=0.07)),
    World("canvas leans", "nib", 12, Effects(canvas_tilt=0.0005)),
    World("wide in bends", "nib", 13, Effects(curvature_width=0.3)),
    World("broad pen dries", "chisel", 14, Effects(drying_shift=0.35), painted_over=True),
    World("pale when fast", "nib", 15, Effects(speed_density=0.35)),
    World("lens", "nib", 16, Effects(lens_distortion=0.035)),
    World("brush, beside", "hairs", 17, Effects(path_offset=0.0012), rows=240),
    World("damp paper", "nib", 18, Effects(paper_bleed=0.18)),
    World("runs out and drags", "nib", 19, Effects(ink_depletion=3.3, bristle_lag=0.003)),
    World("broad, too long, pale when fast", "chisel", 20, Effects(path_scale=0.07, speed_density=0.3)),
    World("red, mixed in sRGB", "nib", 21, color_srgb=_RED, painted_over=True, mixed_in="numbers"),
    World("pale when fast, the same", "nib", 22, Effects(speed_density=0.35), 168, True, 1100, _RED, True, "numbers"),
    World("thin when fast, no times", "nib", 23, Effects(speed_width=0.18), timed=False),
    World("each session its mix", "nib", 24, sessions=3, mixes=(0.93, 1.02, 1.05)),
    World("drags a little, too long", "hairs", 25, Effects(bristle_lag=0.0012, path_scale=0.03)),
)

_HEAD = """\
# The diagnosis in another simulator

Written by `python -m studies.another_simulator.table`; do not edit. The worlds of the [blind tests](blind_tests.md)
come from the virtual studio. These worlds come from a second simulator. It draws discs, swept boxes and hairs as
polygons. Its faults have their own equations: a tractrix for lagging hairs, backlash that is applied point by point,
a pure delay, and paint that thins hyperbolically. The diagnosis gets only the table. *Hidden* lists
`orientation_width` wherever the tool is a broad box, because the table does not describe that shape. *Pixels* is the
number of causes that a baseline names: the likelihood of pixels with the same base and candidates (BIC, forward
selection).

In two worlds, paint mixes with the layer below in sRGB instead of linear light.

These worlds are not a blind test. The decision's weights are fitted to worlds of several simulators, among them these
with other seeds and strengths. *each session its mix* led to a paint mixture per session in the base model, and *thin
when fast, no times* to strokes of unknown age where times are missing.

| world | hidden | named | rivals | gap closed | pixels | s |
|---|---|---|---|---|---|---|
"""


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.another_simulator.table", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("data/studies/another_simulator"))
    args = parser.parse_args()
    said = verdicts(WORLDS, recorded, verdict_by_table, args.out)
    Path("docs/another_simulator.md").write_text(page(said))


def page(said: dict[World, dict[str, Any]]) -> str:
    """Markdown."""
    lines = [_line(world, result) for world, result in said.items()]
    exact = sum(world.truth == named(result) for world, result in said.items())
    pixels = sum(world.truth == frozenset(result["rivals"]["pixels"]) for world, result in said.items())
    false = sum(len(named(result) - world.truth) for world, result in said.items())
    names = sum(len(named(result)) for result in said.values())
    tail = (
        f"\nThe named causes equal the hidden ones in {exact} of {len(said)} worlds; with the likelihood of pixels, in "
        f"{pixels}. False names: {false} of {names}.\n"
    )
    return _HEAD + "\n".join(lines) + "\n" + tail


def _line(world: World, result: dict[str, Any]) -> str:
    right = "" if world.truth == named(result) else " **(not exact)**"
    return (
        f"| {world.name} | {listed(world.truth)} | {listed(named(result))}{right} | {', '.join(rivals(result)) or '–'} "
        f"| {share_closed(result)} | {len(result['rivals']['pixels'])} | {result['seconds']:.0f} |"
    )


if __name__ == "__main__":
    main()

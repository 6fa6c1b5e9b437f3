"""From a bundle and a goal to a sculpture: ``pentimento run --material``, in the virtual studio or by a rig."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from pentimento.bundle.clays import clay_members
from pentimento.bundle.graphs import Graphs
from pentimento.bundle.manifest import ClayFacts
from pentimento.bundle.reader import Bundle, open_bundle
from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ConfigError, PentimentoError
from pentimento.contracts.height_maps import encode_height_png
from pentimento.contracts.images import encode_png
from pentimento.control.checkpoint import SculptureState, has_sculpture, load_sculpture, save_sculpture
from pentimento.control.commission import ClayCommission, ClayGoal, begun, exclusive
from pentimento.control.execute import Session
from pentimento.control.execute_push import HEIGHT_PER_UNIT_M
from pentimento.control.loop import Hooks, Interrupt
from pentimento.control.open_clay import IN_STUDIO, clay_rig, open_clay
from pentimento.control.person import Control, Progress
from pentimento.control.placing import Placer
from pentimento.control.push_safety import MIN_CLEARANCE_M
from pentimento.control.recording import remove_shards, write_push
from pentimento.control.sculpting_settings import SculptingSettings
from pentimento.control.sculptor import Array, Outcome, Sculptor, SculptureProgress, seen_m
from pentimento.goals3d.mesh_files import MESHES
from pentimento.goals3d.shading import photograph
from pentimento.goals3d.sources import FloatArray, height_source, relief_of
from pentimento.planning.pushes.goal import GoalError, fit_goal, raised_goal, sunken_letters
from pentimento.robots.carrier import ask_at_terminal
from pentimento.robots.tools import load_end_effector, load_feeder

SUMMARY: Final = "sculpture.json"
"""In a finished sculpture's folder: number of actions, and errors of height (mm²) and slope before and after."""
PREVIEW: Final = "preview.png"
"""In its folder before anything moves: the clay and the goal, lit, side by side."""
PICTURE: Final = "sculpture.png"
"""In a finished sculpture's folder: the clay before, the goal and the result, lit, side by side."""
_SCAN_PIXELS: Final = (16, 1024)
"""Fewer do not resolve a dent; more take the studio minutes a push."""
_PREVIEW_PX: Final = 384
"""Longer side of each of its pictures, unless scans are finer."""
HEIGHTS: Final = ("before", "goal", "result")
"""Height maps in its folder, 16-bit PNG."""
RECORD: Final = "pushes"
JOURNAL: Final = "journal.jsonl"


class Ended(PentimentoError):
    """A person has stopped the sculpture; its state is on disk."""


def clay_commission_of(
    bundle: Path,
    material: str,
    goal: ClayGoal,
    *,
    world: str | None = None,
    depth_m: float | None = None,
    raised_m: float = 0.0,
    actions: int | None = None,
    seed: int | None = None,
    scan_pixels: int | None = None,
    robot: str = IN_STUDIO,
    execute: bool = False,
) -> ClayCommission:
    """The commission of a command.

    Args:
        world: of the virtual studio; by default the one with the material's name.
        depth_m: depth of the goal's lowest point below the clay's mean height.
        raised_m: height of its highest point above that; above 0 the goal stands on the surface, of placed pellets.
        actions: maximum number of pushes.
        seed: of plan and studio.
        scan_pixels: of a scan, along the slab's longer side; by default as many as the push model's maps have.
        robot: the studio's, or the name or path of a rig file.
        execute: hardware moves; otherwise the studio rehearses.

    The bundle's settings of the material give the depth, the number and the seed that are None.

    Raises:
        BundleError: the bundle is refused.
        ConfigError: the bundle has no push model of that material, or no feeder for a goal above the surface; a scan
            would have too few or too many pixels; or the rig is none to sculpt this with.
        GoalError, ImageError: the goal cannot be read or drawn.
    """
    opened = open_bundle(bundle)
    name = _clay_of(opened, material)
    settings = opened.manifest.sculpting[name]
    pixels = max(opened.manifest.clays[name].shape) if scan_pixels is None else scan_pixels
    if not _SCAN_PIXELS[0] <= pixels <= _SCAN_PIXELS[1]:
        raise ConfigError(
            f"A scan of {pixels} pixels a side cannot be planned on; give {_SCAN_PIXELS[0]} to {_SCAN_PIXELS[1]}."
        )
    if raised_m > 0 and settings.feeder is None:
        raise ConfigError(
            f"Pushes only lower the {material}, and the bundle has no feeder for it that could place material: leave "
            "out --raised, or deploy with a feeder (params.yaml: sculpting)."
        )
    clay_rig(robot, _area_m(opened.manifest.clays[name]), has_feeder=raised_m > 0, execute=execute)
    _relief(goal, (32, 32), settings.side_share, 0.0, tell=lambda _: None)  # so that an error leaves no folder behind
    return ClayCommission(
        str(bundle.resolve()), opened.digest, material, world or material, goal,
        settings.fit.depth_m if depth_m is None else depth_m,
        settings.actions if actions is None else actions,
        settings.planner.seed if seed is None else seed,
        pixels, raised_m, robot, execute,
    )  # fmt: skip


def run_sculpture(
    commission: ClayCommission,
    folder: Path,
    *,
    resume: bool,
    control: Control,
    progress: Progress,
    calibration: Path = Path("calibration"),
    ask: Callable[[str], None] = ask_at_terminal,
) -> SculptureState:
    """Begin or resume a sculpture in a folder; its final state.

    Args:
        calibration: folder of the rig's calibrations, with which hardware moves.
        ask: shows a request of hardware to the person and returns when it is done.

    The state is on disk before and after every push. A sculpture that was killed between two pushes continues
    unchanged. A push whose result is unknown is not recorded: the clay is scanned, and the rest is planned again.

    Raises:
        Ended: a person stopped it.
        PentimentoError, OSError: arguments do not fit, before anything moves; the guard or the robot refused.
    """
    bundle = open_bundle(Path(commission.bundle), commission.digest)
    name = _clay_of(bundle, commission.material)
    facts, settings = bundle.manifest.clays[name], bundle.manifest.sculpting[name]
    if resume and has_sculpture(folder) and load_sculpture(folder).stopped is not None:
        return load_sculpture(folder)
    with exclusive(folder) if resume else begun(folder, commission):
        end_effector = load_end_effector(bundle.folder / "end_effectors" / f"{facts.end_effector}.toml")
        placer = _placer(bundle, name) if commission.robot == IN_STUDIO else None
        opened = open_clay(
            clay_rig(commission.robot, _area_m(facts), has_feeder=commission.raised_m > 0, execute=commission.execute),
            end_effector, world=commission.world, scan_pixels=commission.scan_pixels, seed=commission.seed,
            journal=folder / JOURNAL, execute=commission.execute, calibration=calibration, ask=ask,
            feeder=None if placer is None else placer.feeder,
        )  # fmt: skip
        try:
            robot = opened.robot
            saved = load_sculpture(folder) if has_sculpture(folder) else None
            sessions = saved.sessions + 1 if saved else 1
            # The studio's clock goes on where it stopped: a resumed sculpture is the same session.
            session = Session(f"sculpture-{commission.material}-{commission.seed}", 0.0)
            if not opened.in_studio:
                session = Session(f"{session.name}-{sessions}", robot.clock_s)
            if saved is not None:
                goal = saved.goal_m
                if not opened.in_studio:  # nobody knows what happened to the clay meanwhile
                    saved = replace(saved, progress=replace(saved.progress, pending=True))
            else:
                robot.change_tool(end_effector)
                seen = seen_m(robot.scan())[0]
                goal = _goal(commission, settings, seen, robot.area_m, tell=progress.message)
                _write_lit(folder / PREVIEW, (seen, goal), facts.window_m)
                progress.message(f"The clay is untouched yet; {folder / PREVIEW} shows it and the goal.")
            sculptor = Sculptor(
                robot=robot, end_effector=end_effector, material=commission.material, goal_m=goal,
                members=clay_members(Graphs(bundle), name), grid=facts.shape,
                config=replace(settings.planner, seed=commission.seed), execution=settings.execution,
                count=commission.actions, session=session, item=0,
                record=lambda row: write_push(folder / RECORD, row), placer=placer, unexplained=facts.unexplained,
            )  # fmt: skip
            return _sculpt(sculptor, folder, saved, sessions, control=control, progress=progress)
        finally:
            opened.close()


def _sculpt(
    sculptor: Sculptor,
    folder: Path,
    saved: SculptureState | None,
    sessions: int,
    *,
    control: Control,
    progress: Progress,
) -> SculptureState:
    def checkpoint(state: SculptureProgress) -> SculptureProgress:
        save_sculpture(folder, SculptureState(sculptor.goal_m, state, sessions, None))
        return state

    def interrupt(state: SculptureProgress) -> tuple[SculptureProgress, Interrupt | None]:
        order = control.poll()
        return state, "stop" if order is not None and order.command == "stop" else None

    def show(state: SculptureProgress) -> None:
        progress.step(
            "action" if sculptor.placer else "push", len(state.actions), sculptor.count, f"error {state.values[-1]:.4f}"
        )

    state = sculptor.begin()[0] if saved is None else saved.progress
    # A push is recorded before it is confirmed: one that never was has a row that is taken back.
    remove_shards(folder / RECORD, len(state.actions))
    if state.pending:
        state = sculptor.rescan(state)
    elif saved is not None and state.due == 0:  # it ended between the last push of a plan and the next plan
        state = sculptor.replan(state, changed=False)
    hooks = Hooks(interrupt=interrupt, checkpoint=checkpoint, on_action=show)
    state, stopped = sculptor.run(checkpoint(state), hooks)
    if stopped is None:
        raise Ended(f"Stopped after {len(state.actions)} pushes. Go on with: pentimento run --resume {folder}")
    _write_summary(folder, sculptor, state, stopped)
    final = SculptureState(sculptor.goal_m, state, sessions, stopped)
    save_sculpture(folder, final)  # last, so that a sculpture that is saved as done is complete
    return final


def _placer(bundle: Bundle, name: str) -> Placer | None:
    feeder = bundle.manifest.sculpting[name].feeder
    if feeder is None:
        return None
    return Placer(load_feeder(bundle.folder / "feeders" / f"{feeder}.toml"), bundle.places[name])


def _area_m(facts: ClayFacts) -> tuple[float, float]:
    """Width and height of the slab of a push model."""
    x_min, y_min, x_max, y_max = facts.window_m
    return x_max - x_min, y_max - y_min


def _clay_of(bundle: Bundle, material: str) -> str:
    """The name of a material's push model in the bundle."""
    name = f"clay_{material}"
    if name not in bundle.manifest.clays:
        known = ", ".join(sorted(clay.removeprefix("clay_") for clay in bundle.manifest.clays)) or "none"
        raise ConfigError(f"The bundle has no push model of {material!r}; it has: {known}. Choose one with --material.")
    return name


def _goal(
    commission: ClayCommission,
    settings: SculptingSettings,
    height_m: Array,
    area_m: tuple[float, float],
    *,
    tell: Callable[[str], None],
) -> Array:
    """The goal heights [H, W] of the commission for the clay as scanned; sentences on its fit go to ``tell``."""
    shape, mean_m = (height_m.shape[0], height_m.shape[1]), float(height_m.mean(dtype=np.float64))
    blur_px = settings.edge_blur_m * shape[1] / area_m[0]
    relief = _relief(commission.goal, shape, settings.side_share, blur_px, tell=tell)
    if commission.raised_m > 0:
        up = -relief if commission.goal.kind == "letter" else relief  # letters are sunken
        return raised_goal(up, height_m, raised_m=commission.raised_m, border_share=settings.fit.border_share).height_m
    depth_m = min(commission.depth_m, mean_m - MIN_CLEARANCE_M)
    if depth_m <= 0:
        raise GoalError(f"The clay is {1e3 * mean_m:.1f} mm high, too thin to sculpt; put more of it on the table.")
    if depth_m < commission.depth_m:
        tell(
            f"The clay is {1e3 * mean_m:.1f} mm high on average, so the goal is {1e3 * depth_m:.1f} mm deep instead of "
            f"{1e3 * commission.depth_m:.1f} mm."
        )
    fit = fit_goal(relief, height_m, replace(settings.fit, depth_m=depth_m))
    if fit.alpha == 0:
        tell("The goal is flat; the clay will be smoothed.")
    if fit.raised:
        tell(
            f"{100 * fit.raised / fit.height_m.size:.2g} % of the goal lay deeper than the tools reach and was raised."
        )
    return fit.height_m


def _relief(
    goal: ClayGoal, shape: tuple[int, int], share: float, blur_px: float, *, tell: Callable[[str], None]
) -> FloatArray:
    """The relief [H, W] of a goal, centred, with edges that the tools can form.

    Raises:
        GoalError, ImageError: it cannot be read or drawn.
    """
    suffix, font = Path(goal.value).suffix.lower(), None if goal.font is None else Path(goal.font)
    match goal.kind:
        case "letter":
            if font is None and goal.value.isascii():  # plain strokes, about as wide as a groove
                return sunken_letters(goal.value, shape, share, blur_px)
            source = f"letter:{goal.value}"
        case "mesh":
            if suffix not in MESHES:
                raise GoalError(f"{goal.value} is no mesh file; give one that ends in {', '.join(MESHES)}.")
            source = goal.value
        case "heights":
            source = height_source(Path(goal.value), tell)
        case "image":
            if suffix in (*MESHES, ".npy"):
                raise GoalError(f"{goal.value} is no picture; give it with --goal-mesh or --goal-heights.")
            source = goal.value
    return relief_of(source, shape, share, soften_px=blur_px, up=goal.up, font=font, tell=tell)


def _write_lit(file: Path, heights_m: Sequence[Array], window_m: ArrayLike) -> None:
    """Write height maps [H, W] as photographs in a low light, side by side."""
    scale = max(_PREVIEW_PX // max(heights_m[0].shape), 1)
    atomic_write(file, encode_png(np.hstack([photograph(each, np.array(window_m), scale) for each in heights_m])))


def _write_summary(folder: Path, sculptor: Sculptor, state: SculptureProgress, stopped: Outcome) -> None:
    maps = (state.heights_m[0], sculptor.goal_m, state.heights_m[-1])
    for name, heights in zip(HEIGHTS, maps, strict=True):
        atomic_write(folder / f"{name}.png", encode_height_png(heights, HEIGHT_PER_UNIT_M))
    _write_lit(folder / PICTURE, maps, sculptor.members[0].window_m)
    objective, ends = sculptor.foresight.objective, np.stack([maps[0], maps[2]])
    error, slope = objective.error_3d_mm2(ends).tolist(), objective.visual_error(ends).tolist()
    summary = {
        "actions": len(state.actions),
        "stopped": stopped,
        "error_3d_mm2": {"before": error[0], "after": error[1]},
        "visual_error": {"before": slope[0], "after": slope[1]},
        "holes_filled": state.holes,
    }
    atomic_write(folder / SUMMARY, (json.dumps(summary, indent=2) + "\n").encode())

"""The collection's design: repeats for the floor, nothing that goes with anything else, the same for the same seed."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.collection.design import CollectionConfig, Command, design_collection
from pentimento.contracts.frames import window_around
from pentimento.control.safety import envelope_for
from pentimento.robots.motion import tip_speeds
from pentimento.robots.tools import Tool, load_tool

SIZE_M = (0.30, 0.20)
PALETTE = np.array([[0.1, 0.1, 0.1], [0.1, 0.1, 0.5], [0.5, 0.1, 0.1]])
PAINTS = tuple((float(r), float(g), float(b)) for r, g, b in PALETTE)
CONFIG = CollectionConfig(108, 12, 3, 0.3, 24, 0.01, 0.008, 1000.0, (1.0, 100.0), PAINTS, 0.5, 3)
BRUSH = load_tool("round_brush")


def design(tool: Tool = BRUSH, config: CollectionConfig = CONFIG) -> list[Command]:
    return design_collection(tool, SIZE_M, PALETTE, config)


@pytest.fixture(scope="module")
def commands() -> list[Command]:
    return design()


def test_counts_are_those_of_the_config(commands: list[Command]) -> None:
    _, times = np.unique([command.action_id for command in commands], return_counts=True)
    assert len(commands) == 108
    assert sorted(times) == [1] * 72 + [3] * 12
    assert [command.sheet for command in commands] == sorted(command.sheet for command in commands)


def test_repeats_share_path_paint_and_dip_on_different_sheets(commands: list[Command]) -> None:
    for action in range(72, 84):
        repeats = [command for command in commands if command.action_id == action]
        assert len({command.sheet for command in repeats}) == 3
        assert all(np.array_equal(c.stroke.path, repeats[0].stroke.path) for c in repeats)
        assert all(np.array_equal(c.stroke.color_srgb, repeats[0].stroke.color_srgb) for c in repeats)
        assert all(command.stroke.dip for command in repeats)


def test_repeated_actions_find_blank_paper(commands: list[Command]) -> None:
    met = 0
    for index, command in enumerate(commands):
        if command.action_id < 72:
            continue
        before = [c for c in commands[:index] if c.sheet == command.sheet]
        met += any(overlap(command, other) for other in before)
    assert met <= 1  # of 36: where a sheet is full, the least of overlaps is taken


def overlap(one: Command, other: Command) -> bool:
    a, b = (window_around(c.stroke.path, BRUSH.nominal_width_m / 2) for c in (one, other))
    return bool(np.all(a[:2] < b[2:]) and np.all(b[:2] < a[2:]))


def test_some_single_strokes_cross_paint_if_they_are_to(commands: list[Command]) -> None:
    def share(of: list[Command]) -> float:
        singles = [(i, c) for i, c in enumerate(of) if c.action_id < 72]
        crossing = [any(overlap(c, o) for o in of[:i] if o.sheet == c.sheet) for i, c in singles]
        return float(np.mean(crossing))

    assert 0.15 < share(commands) < 0.5
    assert share(design(config=replace(CONFIG, crossing_share=0.0))) < 0.05


@pytest.mark.parametrize("tool", ["round_brush", "flat_brush", "marker"])
def test_every_command_passes_the_envelope_and_keeps_the_tools_ranges(tool: str) -> None:
    known = load_tool(tool)
    envelope = envelope_for(known, SIZE_M)
    for command in design(known, replace(CONFIG, strokes=40, repeated=5)):
        path = command.stroke.path
        envelope.check_path(path)
        assert path[:, 1:3].min() >= 0.008 and (path[:, 1:3].max(0) <= np.array(SIZE_M) - 0.008).all()
        assert tip_speeds(path).max() <= known.speed_range_m_s[1] * (1 + 1e-9)
        assert 1.0 <= command.wait_s <= 100.0
        assert known.dips or not command.stroke.dip


def test_design_factors_are_uncorrelated(commands: list[Command]) -> None:
    """Largest correlation of order, place, heading, length, press and speed; chance gives about .3 at 84 actions."""
    paths = {c.action_id: (order, c.stroke.path) for order, c in reversed(list(enumerate(commands)))}
    factors = []
    for order, path in paths.values():
        chord = path[-1, 1:3] - path[0, 1:3]
        heading = np.arctan2(chord[1], chord[0])
        length = np.hypot(*np.diff(path[:, 1:3], axis=0).T).sum()
        factors.append(
            [order, *path[:, 1:3].mean(0), np.cos(heading), np.sin(heading), length, -path[:, 3].mean(),
             np.log(length / path[-1, 0])]
        )  # fmt: skip
    correlation = np.corrcoef(np.array(factors).T)
    assert np.abs(correlation - np.eye(len(correlation))).max() < 0.45


def test_the_same_seed_gives_the_same_commands_and_another_does_not(commands: list[Command]) -> None:
    def values_of(of: list[Command]) -> list[object]:
        return [(c.action_id, c.sheet, c.stroke.path.tolist(), c.stroke.dip, c.wait_s) for c in of]

    assert values_of(design()) == values_of(commands)
    assert values_of(design(config=replace(CONFIG, seed=4))) != values_of(commands)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("strokes", 0), ("repeated", -1), ("repeated", 60), ("times", 0), ("crossing_share", -0.1),
        ("crossing_share", 1.5),
        ("path_points", 1), ("margin_m", 0.0), ("edge_m", -0.1), ("pixels_per_m", 0.0), ("settle_s", (0.0, 1.0)),
        ("settle_s", (2.0, 1.0)), ("yaw_spread_rad", -1.0), ("seed", -1), ("palette_srgb", ()),
        ("palette_srgb", ((2.0, 0.0, 0.0),)),
    ],
)  # fmt: skip
def test_config_rejects_numbers_out_of_range(field: str, value: object) -> None:
    with pytest.raises(ValueError, match=rf"^{field} "):
        replace(CONFIG, **{field: value})


class Corners:
    """Shapes of one kind, in two sizes: there, and back at a right angle."""

    points = 3
    spread = np.ones(1, np.float32)

    def sample(self, count: int, rng: np.random.Generator) -> np.ndarray:
        return rng.choice([0.01, 0.02], (count, 1)).astype(np.float32)

    def paths(self, parameters: np.ndarray) -> tuple[np.ndarray, object]:
        corner = np.array([[-1, -1 / 3], [0, 2 / 3], [1, -1 / 3]], np.float32)
        return parameters[:, :, None] * corner, None

    def constrain(self, parameters: np.ndarray, start: np.ndarray, reach: float) -> None: ...


def test_paths_of_given_shapes_keep_form_and_size_in_any_pose() -> None:
    config = replace(CONFIG, strokes=30, repeated=2, times=3)
    commands = design_collection(BRUSH, SIZE_M, PALETTE, config, Corners())  # type: ignore[arg-type]
    places = np.array([command.stroke.path[:, 1:3] for command in commands])
    sides = np.linalg.norm(np.diff(places, axis=1), axis=2)
    assert np.allclose(sides[:, 0], sides[:, 1], rtol=1e-5)
    assert {round(float(side) / 2**0.5, 4) for side in sides.ravel()} == {0.01, 0.02}
    ends = places[:, 2] - places[:, 0]
    assert np.ptp(np.arctan2(ends[:, 1], ends[:, 0])) > 3
    z = np.array([command.stroke.path[:, 3] for command in commands])
    assert (-z >= BRUSH.press_range_m[0]).all() and (-z <= BRUSH.press_range_m[1]).all() and np.ptp(z[:, 0]) > 1e-3
    assert (places >= CONFIG.edge_m).all() and (places <= np.array(SIZE_M) - CONFIG.edge_m).all()
    assert [c.sheet for c in commands] == [c.sheet for c in design_collection(BRUSH, SIZE_M, PALETTE, config)]

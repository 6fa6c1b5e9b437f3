from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from pentimento.collection.pushes import PushCollectionConfig, PushCommand, design_pushes
from pentimento.contracts.errors import ContractError
from pentimento.robots.driver import span_m
from pentimento.robots.tools import load_end_effector

AREA = (0.2, 0.2)
BALL, GRIPPER = load_end_effector("ball"), load_end_effector("gripper")
CONFIG = PushCollectionConfig(
    pushes=120,
    repeated=8,
    times=3,
    pushes_per_smoothing=(3, 8),
    revisit_share=0.5,
    edge_m=0.025,
    scan_pixels=64,
    seed=4,
)


def ends(command: PushCommand) -> np.ndarray:
    x, y, theta, length, _ = command.action
    return np.array([[x, y], [x + length * np.cos(theta), y + length * np.sin(theta)]])


def test_rows_repeats_and_smoothings_are_as_told() -> None:
    commands = design_pushes(BALL, AREA, CONFIG)
    assert len(commands) == 120
    assert Counter(Counter(command.action_id for command in commands).values()) == {1: 96, 3: 8}
    starts = [i for i, command in enumerate(commands) if command.smooth]
    assert starts[0] == 0
    assert max(np.diff([*starts, 120])) <= 8


def test_repeats_are_the_same_push_first_into_fresh_material() -> None:
    commands = design_pushes(BALL, AREA, CONFIG)
    repeated = {k for k, n in Counter(c.action_id for c in commands).items() if n > 1}
    for action in repeated:
        same = [command for command in commands if command.action_id == action]
        assert all(command.smooth for command in same)
        assert len({(*c.action, c.speed_m_s, c.dwell_s, c.retract_speed_m_s) for c in same}) == 1


def test_every_push_lies_inside_and_within_its_end_effector_s_ranges() -> None:
    for command in design_pushes(BALL, AREA, CONFIG):
        assert ends(command).min() >= 0.025
        assert ends(command).max() <= 0.175
        assert 0 <= command.action[3] <= BALL.travel_m[1]
        assert BALL.depth_m[0] <= command.action[4] <= BALL.depth_m[1]
        assert BALL.speed_range_m_s[0] <= command.speed_m_s <= BALL.speed_range_m_s[1]
        assert BALL.dwell_range_s[0] <= command.dwell_s <= BALL.dwell_range_s[1]
        assert BALL.retract_speed_range_m_s[0] <= command.retract_speed_m_s <= BALL.retract_speed_range_m_s[1]


def test_push_design_factors_are_uncorrelated() -> None:
    commands = design_pushes(BALL, AREA, replace(CONFIG, pushes=400))
    table = np.array(
        [
            [i, *c.action[:2], np.cos(c.action[2]), np.sin(c.action[2]), *c.action[3:], c.speed_m_s, c.dwell_s,
             c.retract_speed_m_s]
            for i, c in enumerate(commands)
        ]
    )  # fmt: skip
    correlation = np.abs(np.corrcoef(table.T) - np.eye(table.shape[1]))
    correlation[[1, 2, 3, 4], [3, 4, 1, 2]] = 0  # a push that starts at the right border goes left
    assert correlation.max() < 0.2


def test_half_of_the_others_are_aimed_at_worked_places() -> None:
    def near(revisit_share: float) -> float:
        hits, seen = 0, 0
        worked: list[np.ndarray] = []
        for command in design_pushes(BALL, AREA, replace(CONFIG, revisit_share=revisit_share)):
            middle = ends(command).mean(axis=0)
            if command.smooth:
                worked = []
            else:
                seen += 1
                hits += min(np.linalg.norm(middle - place) for place in worked) < 0.02
            worked.extend(np.linspace(*ends(command), 5))
        return hits / seen

    assert near(0.0) < near(0.5) < near(1.0)
    assert near(1.0) > 0.85


def test_an_action_depends_on_its_seed_and_number_alone_where_nothing_was_pressed() -> None:
    few, many = (design_pushes(BALL, AREA, replace(CONFIG, pushes=n, revisit_share=0.0)) for n in (60, 120))
    first = {command.action_id: command.action for command in many}
    singles = [command for command in few if command.action_id < 30]
    assert singles
    for command in singles:
        np.testing.assert_array_equal(command.action, first[command.action_id])
    assert not np.allclose(design_pushes(BALL, AREA, replace(CONFIG, seed=5))[0].action, few[0].action)


def test_a_gripper_s_fingers_keep_off_the_edge() -> None:
    for command in design_pushes(GRIPPER, AREA, CONFIG):
        fingers = span_m("pinch", command.action, GRIPPER.opening_m)
        assert np.all((fingers >= 0.025) & (fingers <= 0.175))
        np.testing.assert_allclose(fingers.mean(axis=0), command.action[:2])
        assert GRIPPER.travel_m[0] <= command.action[3] <= GRIPPER.travel_m[1]


def test_a_slab_without_room_is_named() -> None:
    with pytest.raises(ContractError, match="no room"):
        design_pushes(BALL, (0.05, 0.05), CONFIG)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pushes": 0}, "pushes is 0"),
        ({"repeated": 50}, "at least 150 and is [0-9]+: raise pushes, or lower repeated"),
        ({"revisit_share": 1.5}, "at most 1"),
        ({"pushes_per_smoothing": (5, 3)}, "min number"),
        ({"pushes_per_smoothing": (0, 3)}, "from 1"),
        ({"scan_pixels": 4}, "scan_pixels"),
        ({"edge_m": -0.1}, "edge_m"),
    ],
)
def test_bad_settings_are_named(change: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(CONFIG, **change)  # type: ignore[arg-type]

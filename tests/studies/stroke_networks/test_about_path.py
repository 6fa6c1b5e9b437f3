"""How pixels lie about strokes: closed forms on straight lines, and what a mirror does."""

import torch

from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke
from studies.stroke_models.networks.about_path import NAMES, about_path, nearest, odd
from tests.dynamics.strokes.conftest import TRUTH


def test_left_ahead_and_along_of_a_corner() -> None:
    """From the origin 2 along x, then 2 along y."""
    corner = torch.tensor([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]])
    points = torch.tensor([[0.5, 0.3], [-1.0, 0.0], [2.5, 1.0], [2.0, 3.0]])
    found = nearest(corner, points)
    torch.testing.assert_close(found.segment, torch.tensor([0, 0, 1, 1]))
    torch.testing.assert_close(found.left_m, torch.tensor([0.3, 0.0, -0.5, 0.0]))
    torch.testing.assert_close(found.ahead_m, torch.tensor([0.0, -1.0, 0.0, 1.0]))
    torch.testing.assert_close(found.there(torch.tensor([0.0, 2.0, 4.0])), torch.tensor([0.5, 0.0, 3.0, 4.0]))


def test_a_path_that_does_not_move_has_everything_about_its_point() -> None:
    found = nearest(torch.zeros(3, 2), torch.tensor([[3.0, 4.0]]))
    assert all(bool(torch.isfinite(values).all()) for values in found[1:])


def _features(samples: StrokeSamples) -> dict[str, torch.Tensor]:
    parameters = type(TRUTH)((1.0, 1.0), (0.0, 0.0), TRUTH.thickness_per_press, TRUTH.thickness_at_contact_m, 0.3, 0.9)
    with torch.no_grad():
        features = about_path(Traj2Stroke(parameters)(samples.path), samples)
    return dict(zip(NAMES, features.unbind(-1), strict=True))


def _straight(mirrored: bool = False) -> StrokeSamples:
    """One stroke in the middle of its window, along x but for a bend."""
    t = torch.linspace(0, 1, 12)
    bend = 0.01 * t * (1 - t) * (1 + t) * (-1 if mirrored else 1)
    path = torch.stack([t, 0.01 + 0.03 * t, 0.02 + bend, -1e-3 * (1 + t), 0 * t], dim=-1)[None]
    white = torch.ones(1, 40, 50, 3)
    return StrokeSamples(
        path, torch.tensor([[0.0, 0.04]]), torch.tensor([1000.0]), white, white, white, torch.zeros(1, 3),
        torch.zeros(1, 40, 50, dtype=torch.bool), torch.ones(1, 40, 50), torch.zeros(1, dtype=torch.int64),
    )  # fmt: skip


def test_in_the_mirror_what_is_odd_changes_its_sign() -> None:
    features, mirrored = _features(_straight()), _features(_straight(mirrored=True))
    for name, sign in zip(NAMES, odd().tolist(), strict=True):
        torch.testing.assert_close(mirrored[name].flip(1), sign * features[name], atol=2e-5, rtol=1e-4)
        assert sign > 0 or features[name].abs().max() > 0, name


def test_what_is_said_of_a_stroke_holds_for_each_of_its_pixels() -> None:
    features = _features(_straight())
    torch.testing.assert_close(features["chord"], torch.full((1, 40, 50), 0.03))
    torch.testing.assert_close(features["deepest press"], torch.full((1, 40, 50), 2e-3))
    # A millimetre a pixel; the command starts at 10 mm, 20 mm.
    torch.testing.assert_close(features["x"][0, 20, 10], torch.tensor(0.0005))
    torch.testing.assert_close(features["y"][0, 20, 10], torch.tensor(-0.0005))
    assert (features["from start, command"] + features["to end, command"] - features["length"]).abs().max() < 1e-6


def test_the_way_of_the_tip_is_seen_from_each_pixel_and_ends_where_the_stroke_does() -> None:
    straight = _straight()
    straight.path[..., 2] = 0.02
    features = _features(straight)
    # Half a millimetre above the line, 10 and 25 mm from its start of 30: the tip is that much to the right.
    for x, ahead in ((20, {-30: -0.0105, -10: -0.01, 5: 0.005, 20: 0.0195}), (35, {-10: -0.01, 5: 0.0045, 20: 0.0045})):
        for away, there in ahead.items():
            torch.testing.assert_close(
                features[f"tip at {away} mm, ahead"][0, 19, x], torch.tensor(there), atol=2e-6, rtol=0
            )
            torch.testing.assert_close(
                features[f"tip at {away} mm, left"][0, 19, x], torch.tensor(-0.0005), atol=2e-6, rtol=0
            )

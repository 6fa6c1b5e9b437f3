"""The classifier of writers and the two-sample test: correct where strokes differ, at chance where they do not."""

import numpy as np
import pytest

from pentimento.handwriting.demonstrated import Demonstrated
from pentimento.handwriting.evaluation import StrokeClassifier, features, nearest_of_same_hand
from pentimento.handwriting.figures import drawn_map, flat_map
from pentimento.handwriting.recording import turned
from studies.hands.sampling import difference_auc


def paths(strokes: Demonstrated) -> list[np.ndarray]:
    return list(strokes.strokes.xy_m.double().numpy())


def test_classifier_recognises_writers_in_test_sessions(parts: tuple[Demonstrated, Demonstrated]) -> None:
    learned, held_out = parts
    who = StrokeClassifier(paths(learned), learned.hand, 0)
    for number, hand in enumerate(who.hands):
        shares = who.shares(paths(held_out.of(hand)))
        assert shares.sum() == pytest.approx(1)
        assert shares[number] > 0.8
    straight = [np.column_stack([np.linspace(0, 0.04, 9), np.zeros(9)])] * 3
    assert who.shares(straight)[who.hands.index("loops")] == 0


def test_features_are_invariant_to_pose_mirror_and_sampling() -> None:
    t = np.linspace(0, 1, 60)
    path = np.column_stack([0.03 * t, 0.01 * np.sin(5 * t)])
    moved = turned(path * np.array([1, -1]), 1.1) + np.array([0.2, 0.1])
    np.testing.assert_allclose(features([path]), features([moved]), atol=1e-9)


def test_difference_auc_detects_different_sets() -> None:
    rng = np.random.default_rng(0)
    t = np.linspace(0, np.pi, 20)

    def arcs(count: int, wobble_m: float) -> list[np.ndarray]:
        height = rng.uniform(0.002, 0.01, count)
        return [
            np.column_stack([0.03 * t / np.pi, h * np.sin(t)]) + wobble_m * rng.normal(size=(20, 2)) for h in height
        ]

    assert difference_auc(arcs(60, 2e-4), arcs(60, 2e-4), 0, folds=2) == pytest.approx(0.5, abs=0.15)
    assert difference_auc(arcs(60, 2e-4), arcs(60, 2e-5), 0, folds=2) > 0.95


def test_flat_map_keeps_neighbours() -> None:
    rng = np.random.default_rng(0)
    latents = np.concatenate([rng.normal(0, 1, (15, 6)), rng.normal(8, 1, (15, 6))])
    hands = ["ann"] * 15 + ["bob"] * 15
    assert nearest_of_same_hand(latents, hands) == 1
    assert nearest_of_same_hand(flat_map(latents, 0), hands) > 0.9
    picture = drawn_map(flat_map(latents, 0), rng.normal(0, 1e-2, (30, 8, 2)), hands)
    assert (picture < 250).any(axis=-1).sum() > 500

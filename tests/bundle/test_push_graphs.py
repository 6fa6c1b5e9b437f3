"""A push model's graphs as a planning model."""

from pathlib import Path

import numpy as np

from pentimento.bundle.graphs import GraphClay, Graphs
from pentimento.bundle.reader import open_bundle
from tests.bundle.tiny_bundle import write_tiny_bundle
from tests.control.sculpting_bundle import FACTS, add_clay


def test_graph_clay_pull_is_the_derivative(tmp_path: Path) -> None:
    bundle = open_bundle(add_clay(write_tiny_bundle(tmp_path / "bundle")))
    clay = GraphClay(Graphs(bundle), "clay_foam_0", FACTS)
    rng = np.random.default_rng(0)
    height = (0.04 + 1e-3 * rng.standard_normal(FACTS.shape)).astype(np.float32)
    action = np.array([0.08, 0.11, 0.7, 0.02, 0.006])
    after, pull = clay.step(height, action)
    np.testing.assert_array_equal(after, clay.after(height, action[None])[0])
    assert (height - after).max() > 0.005
    loss = np.outer(np.cos(np.arange(FACTS.shape[0]) / 6), np.sin(np.arange(FACTS.shape[1]) / 5)).astype(np.float32)
    to_height, to_action = pull(loss)
    np.testing.assert_array_equal(to_height, loss)  # each dent is cut out of whatever was there
    for number, step in enumerate((1e-3, 1e-3, 1e-2, 1e-3, 1e-3)):
        there = np.stack([action, action])
        there[:, number] += [step, -step]
        more, less = clay.after(height, there).astype(np.float64)
        slope = float(((more - less) * loss).sum() / (2 * step))
        np.testing.assert_allclose(to_action[number], slope, rtol=2e-3)

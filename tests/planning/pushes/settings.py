"""A sculptor small enough for tests."""

from pentimento.planning.objectives import Weights
from pentimento.planning.pushes.config import PushRates, Reach, SculptorConfig

REACH = Reach((0.01, 0.01, 0.09, 0.09), (0.01, 0.03), (0.001, 0.008), width_m=0.012, travels=True)
CONFIG = SculptorConfig(
    weights=Weights(1.0, 1.0), disagreement_weight=1.0, horizon=4, screened=0, candidates=24, rounds=1,
    guided_share=0.7, refine="gradient", iterations=6, learning_rates=PushRates(1e-3, 0.1, 2e-3, 5e-4), samples=12,
    elite_share=0.25, min_relative_gain=0.002, edge_m=0.01, seed=0,
)  # fmt: skip

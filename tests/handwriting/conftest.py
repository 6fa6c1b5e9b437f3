"""A small TrajVAE, trained once for all tests."""

import numpy as np
import pyarrow as pa
import pytest

from pentimento.handwriting.demonstrated import Demonstrated, demonstrated, split_last_session
from pentimento.handwriting.gather import gather
from pentimento.handwriting.repair import Limits
from pentimento.handwriting.synthetic_writers import SyntheticConfig, synthetic_sessions
from pentimento.handwriting.training import Course, TrajVAEConfig, pretrain
from pentimento.handwriting.trajvae import TrajVAE

CONFIG = TrajVAEConfig(
    points=16, latent=8, width=64, kl_weight=3e-4, pretraining=Course(250, 32, 2e-3),
    fine_tuning=Course(80, 12, 1e-3), augmentation_std=0.05, seed=1,
)  # fmt: skip


@pytest.fixture(scope="session")
def table() -> pa.Table:
    recorded = synthetic_sessions(SyntheticConfig(sessions=3, strokes=16, seed=2))
    return gather(recorded, Limits(5, 3e-3, 8.0, 1e-3, 0.6), 16).table


@pytest.fixture(scope="session")
def parts(table: pa.Table) -> tuple[Demonstrated, Demonstrated]:
    return split_last_session(demonstrated(table, 16))


@pytest.fixture(scope="session")
def curve() -> list[float]:
    return []


@pytest.fixture(scope="session")
def model(parts: tuple[Demonstrated, Demonstrated], curve: list[float]) -> TrajVAE:
    return pretrain(parts[0].strokes, CONFIG, lambda _name, value, _step: curve.append(value))


def lengths_mm(paths_m: np.ndarray) -> np.ndarray:
    return 1e3 * np.linalg.norm(np.diff(paths_m, axis=1), axis=-1).sum(1)

"""The state on disk: a round trip, and files that are none."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.covariates import StrokeEvent, advance, fresh_memory
from pentimento.contracts.errors import ContractError
from pentimento.control.checkpoint import PaintingState, load_state, save_state
from pentimento.planning.strokes.bezier import Strokes


def _state() -> PaintingState:
    rng = np.random.default_rng(0)
    shapes = ((4, 2), (4,), (4,), (4,), (4, 3), (4, 3))
    path = np.array([[0, 0.01, 0.02, -0.001, 0], [1, 0.03, 0.02, -0.001, 0]])
    memory = advance(fresh_memory((0.1, 0.08), 0.002), StrokeEvent(path, 3.5, True, np.array([0.1, 0.2, 0.3])))
    return PaintingState(
        remaining=Strokes(*(rng.normal(size=shape).astype(np.float32) for shape in shapes)),
        pending=True,
        palette_srgb=rng.random((3, 3)),
        memory=memory,
        canvas=rng.integers(0, 256, (8, 10, 3), dtype=np.uint8),
        executed=7, sessions=2, shard=3, turns=1, clock_s=12.5, robot_clock_s=99.25, unix_s=1.7e9,
        phase="stopped", message="The cable is out – see to it.",
    )  # fmt: skip


def _same(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.dtype == other.dtype and np.array_equal(one, other, equal_nan=True)
    if hasattr(one, "__dataclass_fields__"):
        return all(_same(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))  # type: ignore[arg-type]
    return one == other


def test_what_is_saved_is_loaded(tmp_path: Path) -> None:
    save_state(tmp_path, _state())
    assert _same(load_state(tmp_path), _state())
    save_state(tmp_path, replace(_state(), executed=8, phase="done"))
    assert load_state(tmp_path).executed == 8
    assert [path.name for path in tmp_path.iterdir()] == ["state.npz"]  # nothing is left lying about


def test_a_folder_without_a_state_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ContractError, match="no painting was begun"):
        load_state(tmp_path)


def test_a_damaged_state_is_refused(tmp_path: Path) -> None:
    save_state(tmp_path, _state())
    whole = (tmp_path / "state.npz").read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], b"x" * 100, whole.replace(b"executed", b"exxcuted")):
        (tmp_path / "state.npz").write_bytes(damaged)
        with pytest.raises(ContractError, match="damaged"):
            load_state(tmp_path)

"""Checkpoints: round trips, and damaged or missing files."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.covariates import StrokeEvent, advance, fresh_memory
from pentimento.contracts.errors import ContractError
from pentimento.control.checkpoint import (
    Arrays,
    PaintingState,
    load_state,
    read_checkpoint,
    save_state,
    write_checkpoint,
)
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.shapes import ShapedStrokes
from tests.bundle.small_hands import HAND_POINTS, small_hand

VALUES: dict[str, Any] = {"executed": 7, "message": "The cable is out – see to it.", "places": [[0.1, 0.2]]}
ARRAYS: Arrays = {"canvas": np.arange(24, dtype=np.uint8).reshape(2, 4, 3), "left_m": np.array([0.5, np.nan])}


def both(values: dict[str, Any], arrays: Arrays) -> tuple[dict[str, Any], Arrays]:
    """The values and arrays by name; a damaged file may have lost some."""
    return {name: values[name] for name in VALUES}, {name: arrays[name] for name in ARRAYS}


def read(path: Path) -> tuple[dict[str, Any], Arrays]:
    return read_checkpoint(path, 3, "fresco", both)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_checkpoint(tmp_path / "state.npz", 3, VALUES, ARRAYS)
    return tmp_path / "state.npz"


def assert_whole(values: dict[str, Any], arrays: Arrays) -> None:
    assert values == VALUES
    for name, array in arrays.items():
        assert array.dtype == ARRAYS[name].dtype
        np.testing.assert_array_equal(array, ARRAYS[name])


def test_checkpoint_round_trip(path: Path) -> None:
    assert_whole(*read(path))
    write_checkpoint(path, 3, VALUES | {"executed": 8}, ARRAYS)
    assert read(path)[0]["executed"] == 8
    assert list(path.parent.iterdir()) == [path]  # no temporary file remains


def test_checkpoint_missing_or_other_schema_is_refused(path: Path) -> None:
    with pytest.raises(ContractError, match=r"holds no other\.npz: no fresco was begun there"):
        read(path.with_name("other.npz"))
    with pytest.raises(ContractError, match="is of schema 3; this version reads schema 4"):
        read_checkpoint(path, 4, "fresco", both)


def test_checkpoint_with_missing_values_is_refused(path: Path) -> None:
    with pytest.raises(ContractError, match=r"damaged .*'strokes'.* begin a new fresco"):
        read_checkpoint(path, 3, "fresco", lambda values, _: values["strokes"])


def test_checkpoint_damaged_anywhere_is_refused_or_unchanged(path: Path) -> None:
    whole = path.read_bytes()
    refused = 0
    for place in range(0, len(whole), 3):
        path.write_bytes(whole[:place])
        with pytest.raises(ContractError, match="damaged"):
            read(path)
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        try:
            values, arrays = read(path)
        except ContractError as error:
            refused += "damaged" in str(error)
            continue
        assert_whole(values, arrays)  # a byte without effect, such as a date
    assert refused > len(whole) / 3 / 2


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
        goal=rng.integers(0, 256, (8, 10, 3), dtype=np.uint8),
        executed=7, sessions=2, shard=3, turns=1, lines=2, clock_s=12.5, robot_clock_s=99.25, unix_s=1.7e9,
        phase="stopped", message="The cable is out – see to it.",
    )  # fmt: skip


def _same(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.dtype == other.dtype and np.array_equal(one, other, equal_nan=True)
    if isinstance(one, tuple):
        return isinstance(other, tuple) and all(map(_same, one, other))
    if hasattr(one, "__dataclass_fields__"):
        return all(_same(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))  # type: ignore[arg-type]
    return one == other


def test_painting_state_round_trip(tmp_path: Path) -> None:
    save_state(tmp_path, _state())
    assert _same(load_state(tmp_path), _state())
    save_state(tmp_path, replace(_state(), executed=8, phase="done"))
    assert load_state(tmp_path).executed == 8
    assert [path.name for path in tmp_path.iterdir()] == ["state.npz"]  # no temporary file remains


def test_strokes_in_a_hand_round_trip_with_their_decoder(tmp_path: Path) -> None:
    rng, decoder = np.random.default_rng(1), small_hand("anna")
    shapes = ((4, 2), (4, 2), (4, 2), (4,), (4, 3), (4, 3))
    strokes = ShapedStrokes(decoder, 0.7, *(rng.normal(size=shape).astype(np.float32) for shape in shapes))
    save_state(tmp_path, replace(_state(), remaining=strokes, hand="bert"))
    loaded = load_state(tmp_path)
    assert _same(loaded, replace(_state(), remaining=strokes, hand="bert"))
    assert isinstance(loaded.remaining, ShapedStrokes)
    np.testing.assert_array_equal(loaded.remaining.paths(HAND_POINTS), strokes.paths(HAND_POINTS))


def test_painting_state_missing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ContractError, match="no painting was begun"):
        load_state(tmp_path)


def test_painting_state_damaged_is_refused(tmp_path: Path) -> None:
    save_state(tmp_path, _state())
    whole = (tmp_path / "state.npz").read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], b"x" * 100, whole.replace(b"executed", b"exxcuted")):
        (tmp_path / "state.npz").write_bytes(damaged)
        with pytest.raises(ContractError, match="damaged"):
            load_state(tmp_path)

"""One file of plain values and arrays: it comes back as it was read_checkpoint, or is refused in a sentence."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.control.checkpoint import Arrays, read_checkpoint, write_checkpoint

TOLD: dict[str, Any] = {"made": 7, "sentence": "The cable is out – see to it.", "places": [[0.1, 0.2]]}
ARRAYS: Arrays = {"canvas": np.arange(24, dtype=np.uint8).reshape(2, 4, 3), "left_m": np.array([0.5, np.nan])}


def both(told: dict[str, Any], arrays: Arrays) -> tuple[dict[str, Any], Arrays]:
    """All that was read_checkpoint, each by its name: a damaged file may have lost some."""
    return {name: told[name] for name in TOLD}, {name: arrays[name] for name in ARRAYS}


def of(path: Path) -> tuple[dict[str, Any], Arrays]:
    return read_checkpoint(path, 3, "fresco", both)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_checkpoint(tmp_path / "state.npz", 3, TOLD, ARRAYS)
    return tmp_path / "state.npz"


def assert_whole(told: dict[str, Any], arrays: Arrays) -> None:
    assert told == TOLD
    for name, array in arrays.items():
        assert array.dtype == ARRAYS[name].dtype
        np.testing.assert_array_equal(array, ARRAYS[name])


def test_it_comes_back_as_it_was_kept_last(path: Path) -> None:
    assert_whole(*of(path))
    write_checkpoint(path, 3, TOLD | {"made": 8}, ARRAYS)
    assert of(path)[0]["made"] == 8
    assert list(path.parent.iterdir()) == [path]  # nothing is left lying about


def test_none_and_another_version_are_sentences(path: Path) -> None:
    with pytest.raises(ContractError, match=r"holds no other\.npz: no fresco was begun there"):
        of(path.with_name("other.npz"))
    with pytest.raises(ContractError, match="is of schema 3; this version reads schema 4"):
        read_checkpoint(path, 4, "fresco", both)


def test_what_it_is_made_of_may_be_missing(path: Path) -> None:
    with pytest.raises(ContractError, match=r"damaged .*'strokes'.* begin the fresco anew"):
        read_checkpoint(path, 3, "fresco", lambda told, _: told["strokes"])


def test_no_damage_is_taken_for_a_state(path: Path) -> None:
    whole = path.read_bytes()
    refused = 0
    for place in range(0, len(whole), 3):
        path.write_bytes(whole[:place])
        with pytest.raises(ContractError, match="damaged"):
            of(path)
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        try:
            told, arrays = of(path)
        except ContractError as error:
            refused += "damaged" in str(error)
            continue
        assert_whole(told, arrays)  # a byte that nothing depends on, such as a date
    assert refused > len(whole) / 3 / 2

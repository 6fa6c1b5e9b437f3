"""The reader reads letters that were rendered otherwise than those it was trained on, and not their mirror images."""

import numpy as np
import pytest

from pentimento.goals3d.letters import letter_relief
from pentimento.goals3d.placing import place, soften
from pentimento.goals3d.reading import LetterReader

LETTERS = "ABCDEF"


@pytest.fixture(scope="module")
def reader() -> LetterReader:
    return LetterReader(LETTERS, examples=30, seed=0)


def sunk(letter: str, seed: int = 0) -> np.ndarray:
    relief = soften(place(letter_relief(letter, 128), (128, 128), 0.68), 2.0)
    noise = np.random.default_rng(seed).normal(0, 1e-4, relief.shape)
    return (0.04 + 0.004 * relief + noise).astype(np.float32)


def test_rendered_letters_are_read(reader: LetterReader) -> None:
    assert "".join(reader.read(sunk(letter), 0.1).letter for letter in LETTERS) == LETTERS


def test_depth_and_level_do_not_matter(reader: LetterReader) -> None:
    assert reader.read(0.5 * sunk("B"), 0.1).letter == "B"


def test_a_letter_over_traces_of_another_is_read(reader: LetterReader) -> None:
    assert reader.read((sunk("D") + 0.3 * (sunk("A") - 0.04)).astype(np.float32), 0.1).letter == "D"


def test_level_clay_is_no_letter_for_sure(reader: LetterReader) -> None:
    level = (0.04 + np.random.default_rng(1).normal(0, 1e-4, (128, 128))).astype(np.float32)
    assert reader.read(level, 0.1).probability < 0.9
    assert reader.read(sunk("E"), 0.1).probability > reader.read(level, 0.1).probability


def test_the_same_seed_makes_the_same_reader(reader: LetterReader) -> None:
    again = LetterReader(LETTERS, examples=30, seed=0)
    assert again.read(sunk("C"), 0.1) == reader.read(sunk("C"), 0.1)

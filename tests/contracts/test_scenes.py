"""Captions, splits and pictures of the `scenes` contract."""

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import image_cell
from pentimento.contracts.scenes import labels_of, listed, phrase, read_scene, split_of, without_colors


@pytest.mark.parametrize(
    ("kind", "color", "expected"),
    [("apple", None, "an apple"), ("apple", "red", "a red apple"), ("cup", "orange", "an orange cup")],
)
def test_phrase_has_the_article_of_its_first_word(kind: str, color: str | None, expected: str) -> None:
    assert phrase(kind, color) == expected


def test_listed_phrases_have_commas_and_a_final_and() -> None:
    assert listed(["a cup"]) == "a cup"
    assert listed(["a cup", "a sun", "a tree"]) == "a cup, a sun and a tree"


def test_without_colors_keeps_all_captions_if_each_names_one() -> None:
    captions = ["a red cup", "a cup", "red, of course"]
    assert without_colors(captions, ["red"]) == ["a cup"]
    assert without_colors(captions[:1], ["red"]) == ["a red cup"]
    assert without_colors(captions, None) == captions


def test_split_of_a_random_number_follows_the_fractions() -> None:
    splits = [split_of(chance, 0.1, 0.2) for chance in np.arange(0.05, 1, 0.1)]
    assert (splits.count("train"), splits.count("val"), splits.count("test")) == (7, 1, 2)


def test_read_scene_rejects_regions_of_another_size() -> None:
    image, regions = np.zeros((4, 6, 3), np.uint8), np.eye(4, 6, dtype=np.uint8)
    row = {"image": image_cell(image), "regions": image_cell(regions)}
    assert labels_of(read_scene(row, "Scene 1")[1]).tolist() == [1]
    with pytest.raises(ContractError, match="Scene 1: its regions are"):
        read_scene(row | {"regions": image_cell(regions[:2])}, "Scene 1")

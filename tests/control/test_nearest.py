"""Words that were never taught become the nearest taught noun, or stay refused."""

from __future__ import annotations

from functools import cache

import pytest

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.contracts.errors import ConfigError
from pentimento.control import nearest
from pentimento.control.request import understand
from pentimento.deploy.words import taught_vocabulary

pytest.importorskip("wordllama", reason="needs the extra voice")

NEAR = {
    "smartwatch": "a watch",
    "doggo": "a dog",
    "sunset": "a sun",
    "moonlight": "a moon",
    "hairbrush": "a paintbrush",
    "pianist": "a piano",
    "flash drive": "a flashlight",
    "ferrari": "a ferris wheel",  # spelt alike only: the person is told, and can say it otherwise
}
FAR = (
    "robot lawnmower", "goldfish bowl", "lawnmower", "drone", "quadcopter", "lightsaber", "tesla", "selfie",
    "milkshake", "smoothie", "snowboarder", "skier", "sushi roll", "ramen", "tiramisu", "gameboy", "playstation",
    "earbuds", "hovercraft", "flip flops", "rainstorm", "sea monster", "zombie", "vampire", "mermaid", "ninja",
    "superhero", "justice", "freedom", "tuesday", "happiness", "mathematics", "democracy", "economy", "love", "music",
    "running", "quickly", "florb", "gnarx", "blorptang", "xyzzy", "qwerty", "chat", "baum", "hund", "perro", "casa",
    "maison", "voiture", "abstract art", "mother", "president", "lawyer", "paris", "london", "germany", "blue",
    "something nice", "surprise", "idea", "tomorrow morning", "password", "software", "internet", "contract",
    "theory", "question", "sentence", "number", "colour", "weather", "silence", "noise",
)  # fmt: skip


@cache
def taught() -> Vocabulary:
    return taught_vocabulary("named")


@pytest.mark.parametrize("said", NEAR)
def test_a_near_word_is_drawn_as_a_taught_noun_and_the_person_is_told(said: str) -> None:
    article = "an" if said[0] in "aeiou" else "a"
    understood = understand(f"{article} {said} under a tree", taught())
    assert understood.text == f"{NEAR[said]} under a tree"
    assert understood.messages() == [f"{article} {said}: drawn as {NEAR[said]}"]


@pytest.mark.parametrize("said", FAR)
def test_a_far_word_is_refused(said: str) -> None:
    with pytest.raises(ConfigError, match="is not understood"):
        understand(f"a {said} beside a cat", taught())


def test_numbers_and_plurals_are_kept() -> None:
    assert understand("three smartwatches", taught()).text == "three watches"
    assert understand("smartwatches", taught()).messages() == ["smartwatches: drawn as two watches"]


def test_describing_words_before_a_near_word_are_left_out() -> None:
    understood = understand("a shiny new smartwatch", taught())
    assert understood.text == "a watch" and understood.left_out == ("shiny", "new")


@pytest.mark.parametrize(
    "said", ["un teacup", "ein chainsaw", "a cat lying quietly", "a dog and a mermaid", "a dog hairbrush"]
)
def test_other_rules_stay_as_they_are(said: str) -> None:
    if said == "a cat lying quietly":
        assert understand(said, taught()).text == "a cat"
    else:
        with pytest.raises(ConfigError, match="is not understood"):
            understand(said, taught())


def test_without_the_package_near_words_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nearest, "find_spec", lambda _: None)
    for said in NEAR:
        with pytest.raises(ConfigError, match=said.split()[-1]):
            understand(f"a {said}", taught())
    assert understand("a poodle", taught()).text == "a dog"

